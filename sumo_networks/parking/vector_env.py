"""ParkingVectorEnv: hundreds of lots in one process, one row per kart, for learners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.envs.array_vector_env import ArrayVectorEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.parking.generate import DAY_TICKS, Scene
from dohyo.sumo_networks.parking.limits import most_karts
from dohyo.sumo_networks.parking.observation import State, action_space, columns, observation_space
from dohyo.sumo_networks.parking.rules import ALIGNED, Outcome, Rules
from dohyo.sumo_networks.parking.world import ParkingWorld

MEASURES = ("aligned", "collided", "timed_out", "time_s", "driven_m", "shunts")


@dataclass(frozen=True, slots=True)
class Level:
    """Difficulty of episodes.

    Attributes:
        scene: Kind of lot.
        rules: When an episode ends, and with which reward.
    """

    scene: Scene
    rules: Rules = ALIGNED


class ParkingVectorEnv(ArrayVectorEnv):
    """Lots drawn from seeds; the karts of a lot are a group of rows.

    An episode of a kart ends when its rules say so; a kart that has ended stays in the lot, and its row waits until the
    lot is reset. The time limit terminates, as the others do, since the thesis gives -1 for it.

    `infos` have at an episode's end "success" (+1 was given) and `MEASURES`: whether the kart was parked and aligned
    (ISO 16787), collided, ran out of time; time, distance driven, changes of direction.

    Attributes:
        world: The lots.
        levels: Levels that `options["level"]` of `reset` chooses from.
    """

    def __init__(
        self, lots: int, levels: Sequence[Level], karts: int = 1, state: State = "oriented", level: int = 0
    ) -> None:
        """Makes lots; episodes begin with their reset.

        Args:
            lots: Number of lots; `num_envs` is this times `karts`.
            levels: At least one.
            karts: Karts in each lot, 1 to 8, in the scene PARALLEL 1 to 5.
            state: Columns of the observation.
            level: Level where `reset` is given none.

        Raises:
            InvalidInputError: There is no lot or no such level, or the number of karts is not possible.
        """
        self.world, self.levels, self._level = ParkingWorld(lots, karts), tuple(levels), level
        self._check_level(level)
        _check_karts(karts, self.levels)
        super().__init__(lots * karts, observation_space(state), action_space(), DAY_TICKS, MEASURES, karts)
        self._columns = columns(state)
        self._actions = np.zeros((lots * karts, 3))

    def _begin_seeded(self, rows: IntArray, seeds: Sequence[int | None], options: Mapping[str, Any]) -> None:
        level = self._check_level(options.get("level", self._level))
        lots = rows[:: self.group_size] // self.group_size
        rng = np.random.default_rng()
        given = [int(rng.integers(2**30)) if seed is None else seed for seed in seeds[:: self.group_size]]
        self.world.draw(lots, given, level.scene, level.rules)

    def _begin(self, rows: IntArray, generators: Sequence[np.random.Generator]) -> None:
        raise NotImplementedError("lots are drawn from seeds")  # pragma: no cover

    def _advance(self, rows: IntArray, actions: FloatArray) -> FloatArray:
        self._actions[rows] = actions
        rewards = self.world.step(self._actions.reshape(self.world.lots, self.world.karts, 3))
        return np.asarray(rewards.reshape(-1)[rows])

    def _observed(self, rows: IntArray) -> FloatArray:
        seen = self.world.observations.reshape(self.num_envs, -1)[rows]
        return np.asarray(seen[:, self._columns])

    def _terminated(self, rows: IntArray) -> BoolArray:
        return ~self.world.running.reshape(-1)[rows]

    def _measured(self, rows: IntArray) -> Mapping[str, FloatArray]:
        results = self.world.results()
        values = {
            "success": results.success,
            "aligned": results.aligned,
            "collided": results.outcome == Outcome.COLLIDED,
            "timed_out": results.outcome == Outcome.TIMED_OUT,
            "time_s": results.time_s,
            "driven_m": results.driven_m,
            "shunts": results.shunts,
        }
        return {name: value.reshape(-1)[rows].astype(np.float64) for name, value in values.items()}

    def _check_level(self, level: int) -> Level:
        if not 0 <= level < len(self.levels):
            raise InvalidInputError(f"expected a level below {len(self.levels)}, got {level}")
        return self.levels[level]


def _check_karts(karts: int, levels: Sequence[Level]) -> None:
    for level in levels:
        name = Scene(level.scene).name.lower()
        if karts > (most := most_karts(name)):
            raise InvalidInputError(f"expected at most {most} karts with a level of the scene '{name}', got {karts}")
