"""Speed planner: once a minute, from late segment speeds and recent pings, a target speed for each lane and place.

One publication: (1) the segments' speeds, brought up to the present by a forecaster, (2) overwritten lane by lane by
the speeds of connected vehicles in the last minute, (3) smoothed by a kernel that looks ahead, (4) searched for a
standing bottleneck, unless the road's own is known, (5) before which a buffer is prescribed; the target is the lower of
the two at each position. Until the next publication the plan is read as if it travelled upstream with the congestion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dohyo.agents.speed_planning import buffer
from dohyo.agents.speed_planning.bottleneck import BottleneckWatch, heads
from dohyo.agents.speed_planning.buffer import BufferPolicy, Squeeze
from dohyo.agents.speed_planning.fundamental_diagram import FREEWAY, Triangle
from dohyo.agents.speed_planning.traffic_state import LaneGrid, forward_kernel, fuse
from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.freeway.measure import Pings
from dohyo.sumo_networks.freeway.road import FreewayRoad

PUBLISHED_EVERY_S = 60.0
ADVECTION_MPS = 4.2
"""Speed at which a plan travels upstream between publications."""
NO_PLAN_MPS, OFF_MAINLINE_MPS = 30.0, 15.0
"""Speeds that vehicles read before the first publication, and on ramps, m/s."""
LOOK_AHEAD_M = (0.0, 200.0, 500.0, 1000.0)
OPEN_GAP_MPS = 3.0
"""Fall of the target over the next 500 m above which vehicles should open a gap, m/s; ours."""


@dataclass(frozen=True, eq=False)
class SpeedPlan:
    """One publication.

    Attributes:
        published_s: Time of day.
        target_mps: (L, X) by lane from the left and sub-segment.
        state_mps: (L, X) the traffic state it was made of, before smoothing.
        cell_m: Length of a sub-segment.
        bottleneck_m: The bottleneck that the plan is for, if there is one.
        buffer_mps: Speed in its buffer.
    """

    published_s: float
    target_mps: FloatArray
    state_mps: FloatArray
    cell_m: float
    bottleneck_m: float | None = None
    buffer_mps: float | None = None

    def at(self, position_m: FloatArray, lane: IntArray, time_s: float) -> FloatArray:
        """(N, 4) target at each vehicle and 200, 500 and 1000 m ahead, m/s.

        Args:
            position_m: (N,) along the mainline, NaN on ramps.
            lane: (N,) from the left, -1 on ramps.
            time_s: Present time.
        """
        shifted = position_m + ADVECTION_MPS * max(time_s - self.published_s, 0.0)
        off = ~np.isfinite(shifted) | (lane < 0)
        places = np.where(off, 0.0, shifted)[:, None] + np.array(LOOK_AHEAD_M)
        cells = np.clip(places / self.cell_m, 0, self.target_mps.shape[1] - 1).astype(np.int64)
        rows = np.clip(lane, 0, len(self.target_mps) - 1)[:, None]
        return np.where(off[:, None], OFF_MAINLINE_MPS, self.target_mps[rows, cells])


def targets(plan: SpeedPlan | None, position_m: FloatArray, lane: IntArray, time_s: float) -> FloatArray:
    """(N, 4) speeds that vehicles read from the present plan, if there is one, m/s."""
    if plan is not None:
        return plan.at(position_m, lane, time_s)
    speed = np.where(lane < 0, OFF_MAINLINE_MPS, NO_PLAN_MPS)
    return np.repeat(speed[:, None], len(LOOK_AHEAD_M), axis=1)


def open_gap(target: FloatArray) -> BoolArray:
    """(N, 4) targets -> (N,) whether to open a gap ahead."""
    return np.asarray(target[:, 0] - target[:, 2] > OPEN_GAP_MPS)


@dataclass(frozen=True, slots=True)
class PlannerConfig:
    """Settings.

    Attributes:
        kernel_m: Width of the forward kernel.
        headroom: Factor on the smoothed state, ours. The fleet's own speeds are in that state and never above the
            target, so that plans may become slower and slower; above 1, speeds can rise, and are smoothed less.
        searched_m: Width of the kernel for the search of the standing bottleneck; a wide one would hide a short queue,
            and the first minutes of a queue count.
        diagram: Of the freeway, as `calibration` fits it.
        bottleneck: Bottleneck of the buffer: that of the road's description, known in advance; or the standing one,
            once it is found.
    """

    kernel_m: float = 3000.0
    headroom: float = 1.0
    searched_m: float = 600.0
    diagram: Triangle = FREEWAY
    bottleneck: Literal["known", "found"] = "known"


class SpeedPlanner:
    """Publishes plans; remembers the last ones' ends of congestion."""

    def __init__(self, road: FreewayRoad, policy: BufferPolicy | None, config: PlannerConfig | None = None) -> None:
        """Makes a planner for one road and one day.

        Args:
            road: The freeway.
            policy: Chooses the buffer's density; without one the smoothed state is the target.
            config: Settings.
        """
        self.road, self.policy = road, policy
        self.config = PlannerConfig() if config is None else config
        self.grid = LaneGrid.of(road)
        self._watch = BottleneckWatch()

    def publish(self, time_s: float, segment_mps: FloatArray | None, pings: Pings) -> SpeedPlan:
        """One publication.

        Args:
            time_s: Time of day.
            segment_mps: (S,) present speed of the segments, NaN where unknown; None without a feed. Unknown
                segments count as free.
            pings: Those of the last minute.
        """
        free = self.config.diagram.free_speed_mps
        known = (
            np.full(self.road.segments, free)
            if segment_mps is None
            else np.where(np.isnan(segment_mps), free, segment_mps)
        )
        state = fuse(self.grid, self.grid.spread(np.clip(known, 0.0, free)), pings, time_s)
        smooth = forward_kernel(state, self.config.kernel_m, self.grid.cell_m)
        mean = self.grid.across(state)
        searched = forward_kernel(mean, self.config.searched_m, self.grid.cell_m)
        ends = heads(searched, free, self.grid.cell_m, self.config.searched_m / 2)
        found = self._watch.update(ends)
        standing = self.road.bottleneck_m if self.config.bottleneck == "known" else found
        target, asked = np.minimum(self.config.headroom * smooth, free), None
        if standing is not None and self.policy is not None:
            asked = self._buffer_speed(self.policy, mean, standing)
            inside = buffer.in_buffer(self.grid.centres_m, standing, self.policy.length_m)
            target = np.where(inside, np.minimum(target, asked), target)
        return SpeedPlan(time_s, target, state, self.grid.cell_m, standing, asked)

    def _buffer_speed(self, policy: BufferPolicy, state: FloatArray, standing: float) -> float:
        """Speed of the density that the policy requests, m/s."""
        diagram = self.config.diagram
        places = standing - buffer.UPSTREAM_M + (np.arange(buffer.CELLS) + 0.5) * buffer.CELL_M
        speed = np.interp(places, self.grid.centres_m, state)
        density = policy.density(diagram.density(speed), self._squeeze(standing), diagram)
        return float(diagram.speed(np.asarray(density)))

    def _squeeze(self, standing: float) -> Squeeze:
        """Lanes before the bottleneck, and the fewest within 1 km after it begins."""
        bounds, lanes = self.road.bounds_m, np.array(self.road.lanes)
        first, before, last = np.clip(
            np.searchsorted(bounds, (standing, standing - 1500.0, standing + 1000.0), side="right") - 1,
            0,
            len(lanes) - 1,
        )
        inside = lanes[min(first, before + 1) : last + 1]
        return Squeeze(int(lanes[before]), int(inside.min() if len(inside) else lanes[first]))
