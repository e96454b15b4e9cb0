"""Connected vehicles: each reads the plan at its place and its own leader, and gets a speed for the next tick.

A mixed fleet, as in the field: of 100 cars 97 limit or set their own cruise control, 3 get speeds from
FollowerStopper. All speeds are bounded by the safe one, and by SUMO's driver model. Near a leader nothing is commanded:
the driver model approaches a queue, and reopens a gap after a cut-in, more smoothly than a commanded speed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from dohyo.agents.speed_planning.acc import STANDING_GAP_M, TIME_GAPS_S, Memory, SetPointPolicy, Settings, stock_acc
from dohyo.agents.speed_planning.follower_stopper import LaneChangeRecovery, envelope, follower_stopper, safe_speed
from dohyo.agents.speed_planning.planner import SpeedPlan, open_gap, targets
from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.process import TICK_S
from dohyo.sumo_networks.freeway.world import FreewayWorld

ACCELERATION_BASED = 0.03
"""Share of the fleet, as in the field test."""
NEAR_M, NEAR_S, COMFORT_MPS2 = 3.0, 0.6, 0.8
"""Least gap for commands, 3 m + 0.6 s; and highest braking that a command may need, m/s^2."""


@dataclass(frozen=True, eq=False)
class Cars:
    """Inputs of N connected vehicles on the mainline.

    Attributes:
        names: Of them.
        speed: (N,) m/s.
        acceleration: (N,) m/s^2.
        gap: (N,) m, infinite without a leader.
        leader: (N,) its speed, m/s.
        leader_names: Of the leaders, None without one.
        target: (N, 4) the plan at 0, 200, 500 and 1000 m, m/s.
    """

    names: tuple[str, ...]
    speed: FloatArray
    acceleration: FloatArray
    gap: FloatArray
    leader: FloatArray
    leader_names: tuple[str | None, ...]
    target: FloatArray

    @classmethod
    def seen(cls, world: FreewayWorld, plan: SpeedPlan | None) -> Cars:
        """The connected vehicles of a world that are on the mainline; those on ramps are not controlled."""
        rows = np.flatnonzero(world.connected & (world.lane >= 0))
        ahead = world.leader[rows]
        return cls(
            tuple(world.names[row] for row in rows),
            world.speed_mps[rows],
            world.acceleration_mps2[rows],
            world.gap_m[rows],
            world.leader_speed_mps[rows],
            tuple(world.names[row] if row >= 0 else None for row in ahead.tolist()),
            targets(plan, world.position_m[rows], world.lane[rows], world.time_s),
        )

    def of(self, rows: IntArray) -> Cars:
        """Selected vehicles."""
        return Cars(
            names=tuple(self.names[row] for row in rows),
            speed=self.speed[rows],
            acceleration=self.acceleration[rows],
            gap=self.gap[rows],
            leader=self.leader[rows],
            leader_names=tuple(self.leader_names[row] for row in rows),
            target=self.target[rows],
        )


class Controller(Protocol):
    """Maps inputs of cars to commanded speeds."""

    def speeds(self, cars: Cars) -> FloatArray:
        """(N,) commanded speeds, m/s."""


@dataclass
class AccelerationBased:
    """FollowerStopper with lane-change recovery, for any number of vehicles."""

    _recovery: dict[str, LaneChangeRecovery] = field(default_factory=dict, init=False)

    def speeds(self, cars: Cars) -> FloatArray:
        """(N,) commanded speeds, m/s."""
        known = self._recovery
        self._recovery = {name: known.get(name) or LaneChangeRecovery() for name in cars.names}
        far = envelope(cars.gap, cars.leader, cars.speed)
        each = list(zip(self._recovery.values(), cars.leader_names, cars.gap.tolist(), far.tolist(), strict=True))
        ease = np.array([one.ease(leader, gap, least, TICK_S) for one, leader, gap, least in each])
        command = follower_stopper(cars.target[:, 0], cars.gap, cars.leader, cars.speed, ease)
        closing = np.where(np.isfinite(cars.gap), cars.leader, np.inf)
        facts = zip(each, command.tolist(), cars.speed.tolist(), closing.tolist(), strict=True)
        return np.array([one.softened(wish, own, gap, ahead, TICK_S) for (one, _, gap, _), wish, own, ahead in facts])


@dataclass(frozen=True, slots=True)
class Limiter:
    """The plan is a speed limit; the driver keeps his own distance."""

    def speeds(self, cars: Cars) -> FloatArray:
        """(N,) commanded speeds, m/s."""
        pairs = zip(cars.speed.tolist(), cars.target[:, 0].tolist(), strict=True)
        wanted = np.array([stock_acc(own, np.inf, 0.0, limit, TIME_GAPS_S[0]) for own, limit in pairs])
        return np.maximum(cars.speed + wanted * TICK_S, 0.0)


@dataclass
class AccBased:
    """A cruise control whose settings a policy chooses, for any number of vehicles.

    Attributes:
        policy: Trained; without one the set speed is the plan's, and the gap the least, or the widest if the plan
            requests a gap.
    """

    policy: SetPointPolicy | None = None
    _memory: dict[str, int] = field(default_factory=dict, init=False)
    _rows: Memory = field(default_factory=lambda: Memory.of(np.empty(0)), init=False)
    _settings: Settings = field(default_factory=lambda: Settings(np.empty(0), np.empty(0)), init=False)

    def speeds(self, cars: Cars) -> FloatArray:
        """(N,) commanded speeds, m/s."""
        memory = self._kept(cars)
        if self.policy is None:
            settings = Settings(cars.target[:, 0], np.where(open_gap(cars.target), 2.0, 0.0))
        else:
            seen = memory.observation(cars.speed, cars.gap, cars.target, open_gap(cars.target))
            settings = self.policy.settings(seen)
        self._settings = settings
        gaps = np.array(TIME_GAPS_S)[settings.gap.astype(np.int64)]
        rows = zip(cars.speed, cars.gap, np.nan_to_num(cars.leader), settings.speed, gaps, strict=True)
        wanted = np.array([stock_acc(*row) for row in rows], dtype=np.float64)
        return np.maximum(cars.speed + wanted * TICK_S, 0.0)

    def _kept(self, cars: Cars) -> Memory:
        """The memory of these vehicles, in their order, with what their last settings have led to, as in the training.

        New vehicles begin with their present speed.
        """
        fresh = Memory.of(cars.speed)
        known = np.array([self._memory.get(name, -1) for name in cars.names], dtype=np.int64)
        old = known >= 0
        rows = known[old]
        kept, settings = self._rows.of_rows(rows), Settings(self._settings.speed[rows], self._settings.gap[rows])
        kept.remember(cars.acceleration[old], cars.speed[old], settings)
        fresh.replace(old, kept)
        self._memory, self._rows = {name: row for row, name in enumerate(cars.names)}, fresh
        return fresh


@dataclass
class Fleet:
    """Commands every connected vehicle on the mainline.

    Attributes:
        seed: Decides which vehicle has which controller.
        acc: Of the cars without FollowerStopper.
        acceleration_based: Share with FollowerStopper.

    Raises:
        InvalidInputError: The share is outside [0, 1].
    """

    seed: int
    acc: Controller = field(default_factory=Limiter)
    acceleration_based: float = ACCELERATION_BASED
    _stoppers: AccelerationBased = field(default_factory=AccelerationBased, init=False)
    _kind: dict[str, bool] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        if not 0 <= self.acceleration_based <= 1:
            raise InvalidInputError(f"expected a share in [0, 1], got {self.acceleration_based}")

    def commands(self, world: FreewayWorld, plan: SpeedPlan | None) -> Mapping[str, float]:
        """The speed of every connected vehicle on the mainline for the next tick, m/s."""
        cars = Cars.seen(world, plan)
        if not cars.names:
            return {}
        for name in cars.names:
            if name not in self._kind:
                self._kind[name] = self._drawn(name) < self.acceleration_based
        stops = np.array([self._kind[name] for name in cars.names])
        speed = np.empty(len(stops))
        both: tuple[tuple[IntArray, Controller], ...] = (
            (np.flatnonzero(stops), self._stoppers),
            (np.flatnonzero(~stops), self.acc),
        )
        for rows, controller in both:
            speed[rows] = controller.speeds(cars.of(rows)) if len(rows) else 0.0
        speed = np.minimum(speed, safe_speed(cars.gap, cars.leader, delay_s=TICK_S, keep_m=STANDING_GAP_M / 2))
        near = handed_back(cars)
        return {name: told for name, told, back in zip(cars.names, speed.tolist(), near, strict=True) if not back}

    def _drawn(self, name: str) -> float:
        """Number in [0, 1) of a vehicle, from the seed and its name alone, so that no other vehicle changes it."""
        digest = hashlib.sha256(f"{self.seed} {name}".encode()).digest()
        return int.from_bytes(digest[:4]) / 2**32


def handed_back(cars: Cars) -> BoolArray:
    """(N,) vehicles without a command: too near to their leader, or closing in too fast for comfort."""
    there = np.isfinite(cars.gap)
    gap, leader = np.where(there, cars.gap, 1e9), np.where(there, cars.leader, np.inf)
    closing = np.maximum(cars.speed - leader, 0.0)
    needed = closing**2 / (2 * np.maximum(gap - NEAR_M, 0.1))
    return np.asarray((gap < NEAR_M + NEAR_S * cars.speed) | (needed > COMFORT_MPS2))
