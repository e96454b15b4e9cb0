"""Platoons on one lane: a given leader, a car with cruise control, then 24 human drivers.

The environment in which the ACC-based controller learns; all copies advance in one compiled loop. The configuration is
the public one of the field test's controller; leaders are ours, drawn at random, since its recordings cannot be
shipped.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
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
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.freeway.energy import fuel_rate

HUMANS = 24
STEP_S = 0.1
HORIZON_S = 200.0
LENGTH_M = 5.0
SMOOTHED_S = 60.0
"""Time over which the plan shows the leader's mean speed, s: a forward kernel, as the planner's."""
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


def draw_leaders(rng: np.random.Generator, roads: int, steps: int) -> FloatArray:
    """(R, T) speeds of leaders in stop-and-go traffic, m/s, at `STEP_S`: random targets, reached as people do."""
    wishes = np.zeros((roads, steps))
    for road in range(roads):
        mean, spread, at = rng.uniform(5, 28), rng.uniform(1, 8), 0
        while at < steps:
            hold = int(rng.uniform(5, 40) / STEP_S)
            wishes[road, at : at + hold] = np.clip(rng.normal(mean, spread), 0, 33)
            at += hold
    speed = np.empty_like(wishes)
    now = wishes[:, 0].copy()
    for step in range(steps):
        now = np.maximum(now + np.clip(0.3 * (wishes[:, step] - now), -2.0, 1.0) * STEP_S, 0.0)
        speed[:, step] = now
    return speed


@dataclass
class PlatoonEnv:
    """R platoons; the first car's cruise control is set every half second.

    Reward per decision: minus the mean fuel of the platoon (g/s), 0.02 times the squared acceleration, 0.05 times the
    excess of the gap over 4 s (s), 0.001 times the squared difference from the plan, and 1 for a headway below 1 s or a
    time to collision below 6 s. The weights are the public configuration's, their arguments ours.

    Attributes:
        seed: Of leaders.
        roads: Copies, R.
    """

    seed: int
    roads: int = 64
    actions: int = field(default=ACTIONS, init=False)
    observations: int = field(default=OBSERVATIONS, init=False)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)

    def reset(self) -> FloatArray:
        """Draws a new leader for every platoon; cars begin in equilibrium behind it."""
        ahead_s = SMOOTHED_S + 120.0
        steps = round((HORIZON_S + ahead_s) / STEP_S)
        self._leader_mps = draw_leaders(self._rng, self.roads, steps)
        begin = self._leader_mps[:, 0]
        spacing = np.minimum((2.2 + 1.3 * begin) / np.sqrt(np.maximum(1 - (begin / 33) ** 4, 0.1)), 80.0) + LENGTH_M
        self._position = -np.arange(1, HUMANS + 2) * spacing[:, None]
        self._speed = np.repeat(begin[:, None], HUMANS + 1, axis=1)
        self._leader_m = np.cumsum(self._leader_mps, axis=1) * STEP_S
        window = round(SMOOTHED_S / STEP_S)
        sums = np.concatenate([np.zeros((self.roads, 1)), np.cumsum(self._leader_mps, axis=1)], axis=1)
        self._plan = (sums[:, window:] - sums[:, :-window]) / window
        self._step = 0
        self.memory = Memory.of(begin.copy())
        self.least_gap_m = np.full(self.roads, np.inf)
        return self._observed()

    def step(self, action: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
        """Simulates half a second."""
        settings = settings_of(action)
        steps = slice(self._step, self._step + round(DECISION_S / STEP_S))
        before, plan = self._speed[:, 0].copy(), self._look_ahead()[:, 0]
        time_gap = np.array(TIME_GAPS_S)[settings.gap.astype(np.int64)]
        fuel, rough, gap, ttc = advance(
            self._position, self._speed, self._leader_m[:, steps], self._leader_mps[:, steps], settings.speed, time_gap
        )
        self._step = steps.stop
        speed = self._speed[:, 0]
        self.memory.remember((speed - before) / DECISION_S, speed.copy(), settings)
        self.least_gap_m = np.minimum(self.least_gap_m, gap)
        headway = gap / np.maximum(speed, 1.0)
        wide = np.clip(self._gap() / np.maximum(speed, 1.0) - 4.0, 0.0, 10.0)
        unsafe = (headway < 1.0) | (ttc < 6.0)
        reward = -fuel - 0.02 * rough - 0.05 * wide - 0.001 * (speed - plan) ** 2 - unsafe
        return self._observed(), reward, self._step >= round(HORIZON_S / STEP_S)

    def _gap(self) -> FloatArray:
        return np.asarray(self._leader_m[:, max(self._step - 1, 0)] - self._position[:, 0] - LENGTH_M)

    def _look_ahead(self) -> FloatArray:
        """(R, 4) plan at the first car and ahead of it, m/s."""
        plan = np.empty((self.roads, len(LOOK_AHEAD_M)))
        for road in range(self.roads):
            at = np.searchsorted(self._leader_m[road], self._position[road, 0] + np.array(LOOK_AHEAD_M))
            plan[road] = self._plan[road, np.minimum(at, self._plan.shape[1] - 1)]
        return plan

    def _observed(self) -> FloatArray:
        plan = self._look_ahead()
        return self.memory.observation(self._speed[:, 0], self._gap(), plan, open_gap(plan))
