"""RSS monitor: judges every observation, and records the critical intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dohyo.agents.planning.surroundings import Neighbour, Surroundings
from dohyo.agents.safety.rss import EGO, SPEED, RssConstants, dangerous, judge
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.sensors.lanes import COLUMNS, ROWS
from dohyo.sumo_networks.sensors.path import BEHIND
from dohyo.sumo_networks.units import TICK_S

SENSORS = ("speedometer", "objects", "path", "conflicts")
"""Sensors of the monitor."""
MUST_YIELD = -1.0
STANDS_M_S = 0.1
HARDEST_M_S2 = 8.0
LEAST_GAP_M = 0.3
_NO_LANES = np.zeros((ROWS, COLUMNS), dtype=np.float32)


@dataclass(frozen=True, slots=True)
class Danger:
    """One actor of a dangerous situation.

    Attributes:
        key: Of the actor.
        gap: Along the path, m; 0 beside.
        least_gap: Required gap, m.
        side_gap: Across the path, m.
        least_side_gap: Required lateral gap, m.
        braking: The proper response, m/s^2; 0 where only the steering must respond.
        side: 1 if the ego must not come nearer to the left, -1 to the right, 0 where only the brakes respond.
    """

    key: int
    gap: float
    least_gap: float
    side_gap: float
    least_side_gap: float
    braking: float
    side: int

    def as_json(self) -> dict[str, Any]:
        """Entry of an explanation."""
        return {
            "actor": self.key,
            "gap_m": [round(self.gap, 2), round(self.least_gap, 2) if math.isfinite(self.least_gap) else None],
            "side_gap_m": [round(self.side_gap, 2), round(self.least_side_gap, 2)],
            "braking_m_s2": round(self.braking, 2),
            "side": self.side,
        }


class RssMonitor:
    """Finds dangerous actors, and whether the ego is in a critical interval.

    A critical interval begins with a dangerous situation, and lasts until the response time after the last danger.

    Attributes:
        dangers: Of the last tick.
        critical: Whether the ego is in a critical interval.
        ticks: Since the last reset.
        critical_ticks: Of these, inside critical intervals.
        longest_standing_s: Longest stand in one critical interval, the sign of a deadlock, s.
    """

    def __init__(self, constants: RssConstants = EGO) -> None:
        vehicle = VehicleParameters()
        self._half_length, self._half_width = vehicle.length / 2, vehicle.width / 2
        self._constants = constants
        self.reset()

    def reset(self) -> None:
        """Clears the state of the last episode."""
        self.dangers: tuple[Danger, ...] = ()
        self.critical = False
        self.ticks = self.critical_ticks = 0
        self.longest_standing_s = 0.0
        self._left, self._stood_s = 0, 0.0
        self._near_since: dict[int, int] = {}
        self._beside_since: dict[int, int] = {}

    @property
    def share(self) -> float:
        """Share of the time in critical intervals."""
        return self.critical_ticks / max(self.ticks, 1)

    def update(self, observation: Observation, around: Surroundings | None = None) -> tuple[Danger, ...]:
        """Updates by one tick.

        Args:
            observation: With at least `SENSORS`.
            around: Made of the observation, if the caller has it.

        Returns:
            Dangerous actors, nearest first.
        """
        around = around or Surroundings({**observation, "lanes": _NO_LANES})
        speed = float(observation["speedometer"][0])
        self.dangers = self._dangers(speed, observation["path"][BEHIND], observation["conflicts"], around.neighbours)
        self._left = response_ticks(self._constants) if self.dangers else max(self._left - 1, 0)
        self.critical = bool(self.dangers) or self._left > 0
        self.ticks += 1
        self.critical_ticks += self.critical
        self._stood_s = self._stood_s + TICK_S if self.critical and speed < STANDS_M_S else 0.0
        self.longest_standing_s = max(self.longest_standing_s, self._stood_s)
        return self.dangers

    def _dangers(
        self, speed: float, here: Float32Array, conflicts: Float32Array, neighbours: Sequence[Neighbour]
    ) -> tuple[Danger, ...]:
        if not neighbours:
            self._near_since, self._beside_since = {}, {}
            return ()
        x, y, heading = (float(v) for v in here[:3])
        offset = x * math.sin(heading) - y * math.cos(heading)
        must_yield = {int(row[7]) for row in conflicts if row[6] >= 0 and row[5] == MUST_YIELD}
        rows = np.array(
            [
                (o.s_low, o.s_high, o.d_low, o.d_high, o.speed, o.along, o.across, o.key in must_yield)
                for o in neighbours
            ],
            dtype=np.float64,
        )
        judged = judge(
            speed * math.cos(heading),
            -speed * math.sin(heading),
            offset,
            self._half_length,
            self._half_width,
            rows,
            self._constants.numbers,
        )
        near, beside = dangerous(judged)
        keys = [one.key for one in neighbours]
        self._near_since = _since(self._near_since, keys, near.tolist(), self.ticks)
        self._beside_since = _since(self._beside_since, keys, beside.tolist(), self.ticks)
        found = [self._danger(speed, keys[n], rows[n], judged[n], offset) for n in np.flatnonzero(near & beside)]
        return tuple(sorted(found, key=lambda danger: danger.gap))

    def _danger(self, speed: float, key: int, row: FloatArray, judged: FloatArray, offset: float) -> Danger:
        """Proper response, on the axis whose distance was kept last; braking wherever it can help."""
        gap, least, side_gap, side_least = judged.tolist()
        on_left = float(row[2] + row[3]) > 2.0 * offset
        lateral_last = self._beside_since[key] > self._near_since[key] or gap == 0.0
        side = (1 if on_left else -1) if lateral_last and side_gap > 0.0 else 0
        braking = 0.0
        if gap > 0.0:
            ahead = row[SPEED] * row[5]
            # At least the constant's braking; harder if needed to avoid the impact.
            closing = max(speed - ahead, 0.0)
            needed = closing**2 / (2.0 * max(gap - LEAST_GAP_M, 0.1))
            braking = min(max(self._constants.braking, needed), HARDEST_M_S2)
        return Danger(key, gap, least, side_gap, side_least, braking, side)


def response_ticks(constants: RssConstants) -> int:
    """Response time in ticks, rounded up: the sum of many 0.1 s in floats is not exact."""
    return math.ceil(constants.reaction_s / TICK_S - 1e-6)


def _since(known: dict[int, int], keys: Sequence[int], holds: Sequence[bool], tick: int) -> dict[int, int]:
    return {key: known.get(key, tick) for key, held in zip(keys, holds, strict=True) if held}
