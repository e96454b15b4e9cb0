"""ParkingEnv: one lot as a ParallelEnv of PettingZoo; each kart is an agent."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.ego.control import InvalidActionError
from dohyo.sumo_networks.envs.env_rows import checked_actions
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.limits import MAX_KARTS, most_karts
from dohyo.sumo_networks.parking.lot import Lot
from dohyo.sumo_networks.parking.observation import State, action_space, columns, observation_space
from dohyo.sumo_networks.parking.picture import draw_picture
from dohyo.sumo_networks.parking.rules import ALIGNED, Outcome, Rules
from dohyo.sumo_networks.parking.world import ParkingWorld
from dohyo.sumo_networks.seeds import episode_seed

Observations = dict[str, Float32Array]
Infos = dict[str, dict[str, Any]]


class ParkingEnv(ParallelEnv):  # type: ignore[misc]
    """One lot; the agents are "kart-0", "kart-1", ...

    Observation and action of an agent: see `observation`. The last info of an agent has "outcome", "success",
    "aligned", "time_s". A kart whose episode has ended stays in the lot and is no agent any more.

    At the time limit an episode is terminated (outcome "timed_out") and never truncated: a learner must not add the
    value of what would follow.

    Attributes:
        world: The lot.
        render_mode: "rgb_array" or None.
    """

    metadata = {"name": "parking", "render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012 - PettingZoo's form

    def __init__(
        self,
        scene: Scene | Lot = Scene.COMPLEX,
        karts: int = 1,
        rules: Rules = ALIGNED,
        state: State = "oriented",
        render_mode: str | None = None,
    ) -> None:
        """Makes the environment; `reset` begins an episode.

        Args:
            scene: Kind of lot, drawn at each reset; or one lot, which each reset begins again.
            karts: Karts in a drawn lot, 1 to 8, in the scene PARALLEL 1 to 5; a given lot has its own.
            rules: When an episode ends, and with which reward.
            state: Columns of the observation.
            render_mode: "rgb_array" for pictures from `render`.

        Raises:
            InvalidInputError: The scene is neither, the number of karts is not possible, or the render mode is unknown.
            UnknownNameError: The state is unknown.
        """
        if render_mode not in (None, "rgb_array"):
            raise InvalidInputError(f"expected render_mode 'rgb_array' or None, got {render_mode!r}")
        self.world = ParkingWorld(1, _checked_karts(karts, scene))
        self.render_mode, self._scene, self._rules, self._state = render_mode, scene, rules, state
        self._columns, self._rng = columns(state), np.random.default_rng()
        self.possible_agents = [f"kart-{number}" for number in range(self.world.karts)]
        self.agents: list[str] = []

    @cache  # noqa: B019 - PettingZoo asks for the same object each time; an env lives as long as its spaces
    def observation_space(self, agent: str) -> Box:
        """See the class."""
        return observation_space(self._state)

    @cache  # noqa: B019 - as above
    def action_space(self, agent: str) -> Box:
        """See the class."""
        return action_space()

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observations, Infos]:
        """Begins an episode.

        Args:
            seed: Of the lot; None: another lot each time.
            options: None are known.

        Raises:
            InvalidInputError: The seed is no whole number from 0 to 2^31 - 1; nothing has changed then.
        """
        if seed is not None:
            seed = episode_seed(seed)
            self._rng = np.random.default_rng(seed)
        if isinstance(self._scene, Lot):
            self.world.place(0, self._scene, self._rules)
        else:
            drawn = int(self._rng.integers(2**30)) if seed is None else seed
            self.world.draw([0], [drawn], self._scene, self._rules)
        self.agents = self.possible_agents[:]
        return self._observations(self.agents), {agent: {} for agent in self.agents}

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[Observations, dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """One tick of 0.1 s.

        Args:
            actions: (3,) of each agent whose episode runs; those of agents whose episode has ended are ignored.

        Raises:
            InvalidInputError: There is no episode.
            InvalidActionError: An action is missing, is for an unknown agent, has another shape, or is not finite;
                nothing has moved then.
        """
        if not self.agents:
            raise InvalidInputError("the episode is over: expected reset before step")
        acted, rewards = self.agents, self.world.step(self._checked(actions))[0]
        results, running = self.world.results(), self.world.running[0]
        numbers = {agent: self._number(agent) for agent in acted}
        self.agents = [agent for agent in acted if running[numbers[agent]]]
        infos: Infos = {agent: {} for agent in acted}
        for agent in set(acted) - set(self.agents):
            number = numbers[agent]
            infos[agent] = {
                "outcome": Outcome(int(results.outcome[0, number])).name.lower(),
                "success": bool(results.success[0, number]),
                "aligned": bool(results.aligned[0, number]),
                "time_s": float(results.time_s[0, number]),
            }
        return (
            self._observations(acted),
            {agent: float(rewards[numbers[agent]]) for agent in acted},
            {agent: agent not in self.agents for agent in acted},
            dict.fromkeys(acted, False),
            infos,
        )

    def render(self) -> NDArray[np.uint8] | None:
        """(480, 480, 3) RGB picture from above; None without a render mode."""
        return None if self.render_mode is None else draw_picture(self.world.view(0))

    def close(self) -> None:
        """Nothing is open."""

    def _checked(self, actions: Mapping[str, Any]) -> FloatArray:
        """(1, K, 3) actions of all karts; 0 where none is expected."""
        if not isinstance(actions, Mapping):
            raise InvalidActionError(f"expected actions by the names of karts, got {type(actions).__name__}")
        if unknown := actions.keys() - set(self.possible_agents):
            got = ", ".join(sorted(map(str, unknown)))
            raise InvalidActionError(f"expected actions of {', '.join(self.possible_agents)}, got some of {got}")
        given = np.zeros((1, self.world.karts, 3))
        for agent in self.agents:
            given[0, self._number(agent)] = _checked(agent, actions)
        return given

    def _number(self, agent: str) -> int:
        return self.possible_agents.index(agent)

    def _observations(self, agents: list[str]) -> Observations:
        seen = self.world.observations[0][:, self._columns]
        return {agent: seen[self._number(agent)] for agent in agents}


def _checked_karts(karts: object, scene: object) -> int:
    """Number of karts in a lot, or in those drawn of a scene."""
    if isinstance(scene, Lot):
        return len(scene.karts)
    if not isinstance(scene, Scene):
        known = ", ".join(f"Scene.{one.name}" for one in Scene)
        raise InvalidInputError(f"expected {known} or a Lot, got {scene!r}"[:200])
    most = most_karts(scene.name.lower())
    if isinstance(karts, bool) or not isinstance(karts, int | np.integer) or not 1 <= karts <= most:
        others = "" if most == MAX_KARTS else f" in the scene '{scene.name.lower()}'"
        raise InvalidInputError(f"expected 1 to {most} karts{others}, got {karts!r}")
    return int(karts)


def _checked(agent: str, actions: Mapping[str, Any]) -> NDArray[Any]:
    if agent not in actions:
        raise InvalidActionError(f"expected an action of '{agent}', got actions of {sorted(actions)}")
    try:
        return checked_actions(actions[agent], (3,), np.float64)
    except InvalidActionError as error:
        raise InvalidActionError(f"action of '{agent}': {error}") from error
