"""BufferEnv: mornings in the macroscopic model, in which the density of a buffer before the bottleneck is learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from gymnasium.spaces import Box

from dohyo.agents.speed_planning import buffer
from dohyo.agents.speed_planning.buffer import Squeeze
from dohyo.agents.speed_planning.training import macroscopic
from dohyo.agents.speed_planning.training.macroscopic import CellRoad, CellTraffic
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.envs.array_vector_env import ArrayVectorEnv

DECISION_S = 60.0
DECISIONS = 90
WARM_UP_S = 600.0
SLOTS = 96
"""Slots for controlled vehicles on each road; a vehicle without a slot drives uncontrolled."""
MEASURES = ("discharge", "requested_mps")


class BufferEnv(ArrayVectorEnv):
    """Roads with a morning's peak, with random demand and a random share of connected vehicles.

    The state is the profile of density around the bottleneck; the action is the buffer's density for the next minute,
    see `buffer.density_of_action`. The reward is the flow into the bottleneck over its capacity.

    Measures: that flow's mean over an episode, and the mean speed that the buffer's density requests (m/s).

    Attributes:
        road: Of all rows.
        squeeze: Its bottleneck.
    """

    def __init__(self, num_envs: int, length_m: float = buffer.TRAINED_M) -> None:
        """Makes rows.

        Args:
            num_envs: Number of roads.
            length_m: Of the buffer.
        """
        seen = Box(-np.inf, np.inf, (buffer.CELLS + 1,), np.float32)
        super().__init__(num_envs, seen, Box(-1.0, 1.0, (1,), np.float32), DECISIONS, MEASURES)
        self.road, self._length_m = CellRoad(), length_m
        before, inside = self.road.lanes[self.road.bottleneck - 1], self.road.lanes[self.road.bottleneck]
        self.squeeze = Squeeze(int(before), int(inside))
        self._minute_steps = round(DECISION_S / self.road.step_s)
        self._driven = np.zeros(num_envs, np.int64)  # the model's steps so far, with those of the warm-up
        self._demand = np.zeros((num_envs, self._minute_steps * (DECISIONS + round(WARM_UP_S / DECISION_S))))
        self._share, self._due, self._discharged, self._requested_mps = np.zeros((4, num_envs))
        empty = macroscopic.empty(self.road, num_envs, SLOTS)
        self._density, self._waiting, self._controlled_m = empty.density, empty.waiting, empty.controlled_m

    def _begin(self, rows: IntArray, generators: Sequence[np.random.Generator]) -> None:
        """Draws mornings, and drives until there is traffic on the roads."""
        for row, rng in zip(rows.tolist(), generators, strict=True):
            self._demand[row] = draw_demand(rng, self.road, self._demand.shape[1])
            self._share[row], self._due[row] = rng.uniform(0.01, 0.10), rng.uniform(0, 1)
        self._driven[rows], self._discharged[rows], self._requested_mps[rows] = 0, 0.0, 0.0
        self._put(rows, macroscopic.empty(self.road, len(rows), SLOTS))
        free = np.full(len(rows), self.road.diagram.free_speed_mps)
        for _ in range(round(WARM_UP_S / DECISION_S)):
            self._minute(rows, free)

    def _advance(self, rows: IntArray, actions: FloatArray) -> FloatArray:
        """One minute under a buffer."""
        speed = self.road.diagram.speed(buffer.density_of_action(actions[:, 0], self.road.diagram))
        flow = self._minute(rows, speed) / (self.road.diagram.capacity * self.squeeze.inside * DECISION_S)
        self._discharged[rows] += flow
        self._requested_mps[rows] += speed
        return flow

    def _observed(self, rows: IntArray) -> FloatArray:
        """The profile as a planner sees it, which knows speeds alone."""
        first = self.road.bottleneck - buffer.bottleneck_cell()
        speed = macroscopic.speeds(self.road, self._traffic(rows))[:, first : first + buffer.CELLS]
        return buffer.observation(self.road.diagram.density(speed), self.squeeze, self.road.diagram)

    def _measured(self, rows: IntArray) -> Mapping[str, FloatArray]:
        means = self._discharged[rows] / DECISIONS, self._requested_mps[rows] / DECISIONS
        return dict(zip(MEASURES, means, strict=True))

    def _minute(self, rows: IntArray, speed: FloatArray) -> FloatArray:
        """(R,) speed requested in the buffer, m/s -> (R,) vehicles that passed into the bottleneck."""
        end, passed, traffic = self.road.bottleneck * self.road.cell_m, np.zeros(len(rows)), self._traffic(rows)
        for _ in range(self._minute_steps):
            inside = buffer.in_buffer(traffic.controlled_m, end, self._length_m)
            advised = np.where(inside, speed[:, None], np.inf)
            demand = self._demand[rows, self._driven[rows]]
            traffic, flows = macroscopic.advance(self.road, traffic, demand, advised)
            self._enter(rows, traffic, flows.entered)
            self._driven[rows] += 1
            passed += flows.discharged
        self._put(rows, traffic)
        return passed

    def _enter(self, rows: IntArray, traffic: CellTraffic, entered: FloatArray) -> None:
        """Makes every n-th entering vehicle a controlled one, where there is a slot."""
        self._due[rows] += entered * self._share[rows]
        ready = np.flatnonzero(self._due[rows] >= 1)
        self._due[rows[ready]] -= 1
        slot = np.argmax(np.isnan(traffic.controlled_m[ready]), axis=1)
        free = np.isnan(traffic.controlled_m[ready, slot])
        traffic.controlled_m[ready[free], slot[free]] = 0.0

    def _traffic(self, rows: IntArray) -> CellTraffic:
        return CellTraffic(self._density[rows], self._waiting[rows], self._controlled_m[rows])

    def _put(self, rows: IntArray, traffic: CellTraffic) -> None:
        self._density[rows], self._waiting[rows] = traffic.density, traffic.waiting
        self._controlled_m[rows] = traffic.controlled_m


def draw_demand(rng: np.random.Generator, road: CellRoad, steps: int) -> FloatArray:
    """(T,) veh/s at each step of a morning: from 60 % of the bottleneck's capacity up to the peak, held, and back."""
    peak, rise_s, hold_s = rng.uniform(0.85, 1.15), rng.uniform(600, 2400), rng.uniform(1200, 3600)
    time_s = np.arange(steps) * road.step_s
    shape = np.clip(np.minimum(time_s / rise_s, 1 - (time_s - rise_s - hold_s) / rise_s), 0, 1)
    level = (0.6 + (peak - 0.6) * shape) * rng.normal(1, 0.1, steps)
    return np.asarray(level * road.diagram.capacity * road.lanes[road.bottleneck]).clip(0)
