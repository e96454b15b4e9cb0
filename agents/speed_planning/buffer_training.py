"""Training of the buffer's density.

    python -m dohyo.agents.speed_planning.buffer_training --seeds 0 1 2 --out out/buffer

The world is the macroscopic model with random demand and random shares of connected vehicles; the state is the profile
of density around the bottleneck, the action the buffer's density for the next minute, the reward the flow through
the bottleneck. The checkpoint of the seed that does best on held-out demands is the one shipped (`--ship`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dohyo.agents.speed_planning import buffer, macroscopic
from dohyo.agents.speed_planning.buffer import BufferPolicy, LearnedBuffer, RuleBuffer, Squeeze
from dohyo.agents.speed_planning.macroscopic import CellRoad, CellTraffic
from dohyo.agents.speed_planning.ppo import PpoConfig
from dohyo.agents.speed_planning.training import Lesson, run
from dohyo.sumo_networks.arrays import FloatArray

DECISION_S = 60.0
EPISODE_S = 5400.0
WARM_UP_S = 600.0
SLOTS = 96
"""Slots for controlled vehicles on each road; a vehicle without a slot drives uncontrolled."""
HELD_OUT = 10_000
CONFIG = PpoConfig(iterations=40, learning_rate=1e-3, batch=720, gamma=0.97, entropy=2e-3)


@dataclass
class BufferEnv:
    """R roads with a morning's peak, and a buffer before the bottleneck.

    Attributes:
        seed: Of demands and shares.
        roads: Copies, R.
        road: All of them.
        length_m: Of the buffer.
    """

    seed: int
    roads: int = 32
    road: CellRoad = field(default_factory=CellRoad)
    length_m: float = buffer.TRAINED_M
    actions: int = field(default=1, init=False)
    observations: int = field(default=buffer.CELLS + 1, init=False)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        before, inside = self.road.lanes[self.road.bottleneck - 1], self.road.lanes[self.road.bottleneck]
        self.squeeze = Squeeze(int(before), int(inside))
        self._begin()

    def reset(self) -> FloatArray:
        """Starts a new morning on every road, with traffic on it."""
        self._begin()
        free = np.full(self.roads, self.road.diagram.free_speed_mps)
        while self._time_s < WARM_UP_S:
            self._minute(free)
        return self._observed()

    def step(self, action: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
        """One minute under a buffer; the reward is the flow into the bottleneck over its capacity."""
        density = buffer.density_of_action(action[:, 0], self.road.diagram)
        reward = self.minute_at(density)
        return self._observed(), reward, self._time_s >= WARM_UP_S + EPISODE_S

    def minute_at(self, density: FloatArray) -> FloatArray:
        """(R,) densities asked for -> (R,) flow into the bottleneck over its capacity."""
        passed = self._minute(self.road.diagram.speed(density))
        most = self.road.diagram.capacity * self.squeeze.inside * DECISION_S
        return passed / most

    @property
    def profile(self) -> FloatArray:
        """(R, CELLS) veh/m and lane around the bottleneck, as a planner sees it, which knows speeds alone."""
        first = self.road.bottleneck - buffer.bottleneck_cell()
        cells = slice(first, first + buffer.CELLS)
        return self.road.diagram.density(macroscopic.speeds(self.road, self.traffic)[:, cells])

    def _observed(self) -> FloatArray:
        return buffer.observation(self.profile, self.squeeze, self.road.diagram)

    def _begin(self) -> None:
        self.traffic = macroscopic.empty(self.road, self.roads, SLOTS)
        self._time_s = 0.0
        draw = self._rng.uniform
        self._peak = draw(0.85, 1.15, self.roads)
        self._rise_s, self._hold_s = draw(600, 2400, self.roads), draw(1200, 3600, self.roads)
        self._share = draw(0.01, 0.10, self.roads)
        self._due = draw(0, 1, self.roads)

    def _demand(self) -> FloatArray:
        """(R,) veh/s: from 60 % of the bottleneck's capacity up to the peak, held, and back."""
        after_peak = self._time_s - self._rise_s - self._hold_s
        shape = np.clip(np.minimum(self._time_s / self._rise_s, 1 - after_peak / self._rise_s), 0, 1)
        level = 0.6 + (self._peak - 0.6) * shape
        noise = self._rng.normal(1, 0.1, self.roads)
        return np.asarray(level * noise * self.road.diagram.capacity * self.squeeze.inside).clip(0)

    def _minute(self, speed: FloatArray) -> FloatArray:
        """(R,) speed asked for in the buffer, m/s -> (R,) vehicles that passed into the bottleneck."""
        end = self.road.bottleneck * self.road.cell_m
        passed = np.zeros(self.roads)
        for _ in range(round(DECISION_S / self.road.step_s)):
            inside = buffer.in_buffer(self.traffic.controlled_m, end, self.length_m)
            advised = np.where(inside, speed[:, None], np.inf)
            self.traffic, passage = macroscopic.advance(self.road, self.traffic, self._demand(), advised)
            self._enter(passage.entered)
            passed += passage.discharged
            self._time_s += self.road.step_s
        return passed

    def _enter(self, entered: FloatArray) -> None:
        """Makes every n-th entering vehicle a controlled one."""
        self._due += entered * self._share
        ready = np.flatnonzero(self._due >= 1)
        if not len(ready):
            return
        self._due[ready] -= 1
        slot = np.argmax(np.isnan(self.traffic.controlled_m[ready]), axis=1)
        free = np.isnan(self.traffic.controlled_m[ready, slot])
        moved = self.traffic.controlled_m.copy()
        moved[ready[free], slot[free]] = 0.0
        self.traffic = CellTraffic(self.traffic.density, self.traffic.waiting, moved)


def discharge(policy: BufferPolicy | None, seed: int, roads: int = 64) -> FloatArray:
    """(R,) mean flow into the bottleneck over its capacity in the episodes of one seed; None: without control."""
    env = BufferEnv(seed, roads, length_m=buffer.TRAINED_M if policy is None else policy.length_m)
    env.reset()
    total, minutes = np.zeros(roads), round(EPISODE_S / DECISION_S)
    for _ in range(minutes):
        critical = np.full(roads, env.road.diagram.critical_density)
        density = critical if policy is None else policy.density(env.profile, env.squeeze, env.road.diagram)
        total += env.minute_at(density)
    return total / minutes


LESSON = Lesson(
    command="dohyo.agents.speed_planning.buffer_training",
    checkpoint=buffer.CHECKPOINT,
    config=CONFIG,
    world=BufferEnv,
    judged=lambda actor: discharge(LearnedBuffer(actor), HELD_OUT),
    others=lambda: {"none": discharge(None, HELD_OUT), "rule": discharge(RuleBuffer(), HELD_OUT)},
    unit="of the bottleneck's capacity",
)

if __name__ == "__main__":
    run(LESSON, __doc__)
