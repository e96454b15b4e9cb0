"""Platoons on one lane: a given leader, a car with cruise control, then 24 human drivers.

The environment in which the ACC-based controller learns; all rows advance in one compiled loop. The configuration is
the public one of the field test's controller; leaders are ours, drawn at random, since its recordings cannot be
shipped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from gymnasium.spaces import Box
from numba import njit

from dohyo.agents.speed_planning.acc import (
    ACTIONS,
    DECISION_S,
    OBSERVATIONS,
    TIME_GAPS_S,
    Memory,
    settings_of,
    stock_acc,
)
from dohyo.agents.speed_planning.planner import LOOK_AHEAD_M, open_gap
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.envs.array_vector_env import ArrayVectorEnv
from dohyo.sumo_networks.freeway.energy import fuel_rate

HUMANS = 24
STEP_S = 0.1
HORIZON_S = 200.0
LENGTH_M = 5.0
DECISIONS = round(HORIZON_S / DECISION_S)
SMOOTHED_S = 60.0
"""Time over which the plan shows the leader's mean speed, s: a forward kernel, as the planner's."""
LEADER_STEPS = round((HORIZON_S + SMOOTHED_S + 120.0) / STEP_S)
"""Steps of a leader: the plan looks ahead of the episode's end."""
MEASURES = ("fuel_g_s", "speed_mps", "unsafe", "least_gap_m")
IDM = (33.0, 1.3, 1.0, 2.0, 2.2)
"""Human drivers: desired speed m/s, time gap s, acceleration and comfortable braking m/s^2, standing gap m."""


@njit(cache=True)
def idm(speed: float, gap: float, leader: float) -> float:
    """Acceleration of a human driver, m/s^2. Source: Treiber, Hennecke and Helbing 2000."""
    desired, time_gap, accelerates, brakes, standing = IDM
    wish = standing + max(0.0, time_gap * speed + speed * (speed - leader) / (2 * np.sqrt(accelerates * brakes)))
    return float(max(accelerates * (1 - (speed / desired) ** 4 - (wish / max(gap, 0.1)) ** 2), -8.0))


@njit(cache=True)
def advance(
    position: FloatArray,
    speed: FloatArray,
    ahead_m: FloatArray,
    ahead_mps: FloatArray,
    setting: FloatArray,
    time_gap: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Simulates R platoons for the S given steps of their leaders.

    Args:
        position: (R, N) m, front car first; changed in place.
        speed: (R, N) m/s; changed in place.
        ahead_m: (R, S) the leader's position.
        ahead_mps: (R, S) its speed.
        setting: (R,) set speed of the first car, m/s.
        time_gap: (R,) its set gap, s.

    Returns:
        (R,) mean fuel of a car, g/s; (R,) mean squared acceleration of the first car, m^2/s^4; (R,) its least gap, m;
        (R,) its least time to collision, s.
    """
    roads, cars = position.shape
    steps = ahead_m.shape[1]
    fuel, rough = np.zeros(roads), np.zeros(roads)
    least_gap, least_ttc = np.full(roads, np.inf), np.full(roads, np.inf)
    for road in range(roads):
        for step in range(steps):
            front_m, front_mps = ahead_m[road, step], ahead_mps[road, step]
            for car in range(cars):
                v = speed[road, car]
                gap = front_m - position[road, car] - LENGTH_M
                if car == 0:
                    a = stock_acc(v, gap, front_mps, setting[road], time_gap[road])
                    rough[road] += a * a / steps
                    least_gap[road] = min(least_gap[road], gap)
                    if v > front_mps:
                        least_ttc[road] = min(least_ttc[road], gap / (v - front_mps))
                else:
                    a = idm(v, gap, front_mps)
                front_m, front_mps = position[road, car], v
                after = max(v + a * STEP_S, 0.0)
                fuel[road] += fuel_rate(v, (after - v) / STEP_S) / (steps * cars)
                position[road, car] += (v + after) / 2 * STEP_S
                speed[road, car] = after
    return fuel, rough, least_gap, least_ttc


def draw_wishes(rng: np.random.Generator, steps: int) -> FloatArray:
    """(T,) speeds that a leader in stop-and-go traffic aims at, m/s, at `STEP_S`."""
    wishes = np.zeros(steps)
    mean, spread, at = rng.uniform(5, 28), rng.uniform(1, 8), 0
    while at < steps:
        hold = int(rng.uniform(5, 40) / STEP_S)
        wishes[at : at + hold] = np.clip(rng.normal(mean, spread), 0, 33)
        at += hold
    return wishes


@njit(cache=True)
def reached(wishes: FloatArray) -> FloatArray:
    """(R, T) speeds aimed at, m/s -> (R, T) speeds driven, as people reach them."""
    speed = np.empty_like(wishes)
    for road in range(len(wishes)):
        now = wishes[road, 0]
        for step in range(wishes.shape[1]):
            change = min(max(0.3 * (wishes[road, step] - now), -2.0), 1.0)
            now = max(now + change * STEP_S, 0.0)
            speed[road, step] = now
    return speed


@njit(cache=True)
def look_up(place: FloatArray, values: FloatArray, rows: IntArray, wanted: FloatArray) -> FloatArray:
    """Values at given places.

    Args:
        place: (N, T) ascending.
        values: (N, T') of the first places.
        rows: (R,) of both.
        wanted: (R, K) places.

    Returns:
        (R, K) value of the first place that is not before the wanted one; the last value if there is none.
    """
    found = np.empty_like(wanted)
    for index, row in enumerate(rows):
        at = np.searchsorted(place[row], wanted[index])
        for column in range(wanted.shape[1]):
            found[index, column] = values[row, min(at[column], values.shape[1] - 1)]
    return found


class PlatoonEnv(ArrayVectorEnv):
    """Platoons; the first car's cruise control is set every half second, see `acc.settings_of`.

    Reward per decision: minus the mean fuel of the platoon (g/s), 0.02 times the squared acceleration, 0.05 times the
    excess of the gap over 4 s (s), 0.001 times the squared difference from the plan, and 1 for a headway below 1 s or a
    time to collision below 6 s. The weights are the public configuration's, their arguments ours.

    Measures: mean fuel of a car (g/s), mean speed of the first car (m/s), share of decisions with the headway or time
    to collision above, least gap (m).
    """

    def __init__(self, num_envs: int) -> None:
        """Makes rows.

        Args:
            num_envs: Number of platoons.
        """
        seen, set_ = Box(-np.inf, np.inf, (OBSERVATIONS,), np.float32), Box(-1.0, 1.0, (ACTIONS,), np.float32)
        super().__init__(num_envs, seen, set_, DECISIONS, MEASURES)
        self._leader_mps, self._leader_m = np.zeros((2, num_envs, LEADER_STEPS))
        self._plan = np.zeros((num_envs, LEADER_STEPS - round(SMOOTHED_S / STEP_S) + 1))
        self._position, self._speed = np.zeros((2, num_envs, HUMANS + 1))
        self._ahead = np.zeros((num_envs, len(LOOK_AHEAD_M)))
        self._memory = Memory.of(np.zeros(num_envs))
        self._sums, self._least_gap_m = np.zeros((num_envs, 3)), np.zeros(num_envs)

    def _begin(self, rows: IntArray, generators: Sequence[np.random.Generator]) -> None:
        """Draws a leader for every platoon; cars begin in equilibrium behind it."""
        leader = reached(np.stack([draw_wishes(rng, LEADER_STEPS) for rng in generators]))
        window, begin = round(SMOOTHED_S / STEP_S), leader[:, 0]
        sums = np.concatenate([np.zeros((len(rows), 1)), np.cumsum(leader, axis=1)], axis=1)
        self._leader_mps[rows], self._leader_m[rows] = leader, sums[:, 1:] * STEP_S
        self._plan[rows] = (sums[:, window:] - sums[:, :-window]) / window
        spacing = np.minimum((2.2 + 1.3 * begin) / np.sqrt(np.maximum(1 - (begin / 33) ** 4, 0.1)), 80.0) + LENGTH_M
        self._position[rows] = -np.arange(1, HUMANS + 2) * spacing[:, None]
        self._speed[rows] = begin[:, None]
        self._memory.replace(rows, Memory.of(begin))
        self._sums[rows], self._least_gap_m[rows] = 0.0, np.inf

    def _advance(self, rows: IntArray, actions: FloatArray) -> FloatArray:
        """Simulates half a second."""
        settings, memory = settings_of(actions), self._memory.of_rows(rows)
        position, speed = self._position[rows], self._speed[rows]
        before, plan = speed[:, 0].copy(), self._ahead[rows, 0]
        leader = rows[:, None], self._driven(rows)[:, None] + np.arange(round(DECISION_S / STEP_S))
        time_gap = np.array(TIME_GAPS_S)[settings.gap.astype(np.int64)]
        fuel, rough, gap, ttc = advance(
            position, speed, self._leader_m[leader], self._leader_mps[leader], settings.speed, time_gap
        )
        self._position[rows], self._speed[rows] = position, speed
        own, left = speed[:, 0], self._leader_m[leader][:, -1] - position[:, 0] - LENGTH_M
        memory.remember((own - before) / DECISION_S, own, settings)
        self._memory.replace(rows, memory)
        per_second = np.maximum(own, 1.0)
        unsafe = (gap / per_second < 1.0) | (ttc < 6.0)
        self._sums[rows] += np.stack([fuel, own, unsafe], axis=1)
        self._least_gap_m[rows] = np.minimum(self._least_gap_m[rows], gap)
        wide = np.clip(left / per_second - 4.0, 0.0, 10.0)
        return np.asarray(-fuel - 0.02 * rough - 0.05 * wide - 0.001 * (own - plan) ** 2 - unsafe)

    def _observed(self, rows: IntArray) -> FloatArray:
        first, speed = self._position[rows, 0], self._speed[rows, 0]
        leader = self._leader_m[rows, np.maximum(self._driven(rows) - 1, 0)]
        plan = look_up(self._leader_m, self._plan, rows, first[:, None] + np.array(LOOK_AHEAD_M))
        self._ahead[rows] = plan
        return self._memory.of_rows(rows).observation(speed, leader - first - LENGTH_M, plan, open_gap(plan))

    def _measured(self, rows: IntArray) -> Mapping[str, FloatArray]:
        means = self._sums[rows].T / DECISIONS
        return dict(zip(MEASURES, (*means, self._least_gap_m[rows]), strict=True))

    def _driven(self, rows: IntArray) -> IntArray:
        """(R,) steps of the leader so far."""
        return self._steps[rows] * round(DECISION_S / STEP_S)
