"""FreewayWorld: the state of the freeway after a tick, as arrays with one row per vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.freeway.road import FreewayRoad

NO_LANE = -1


@dataclass(frozen=True, eq=False)
class FreewayWorld:
    """All N vehicles on the road, in the order of their entry. No other world shares the arrays.

    Attributes:
        road: The freeway.
        time_s: Time of day, s since midnight.
        names: Names of the vehicles; a name is never used again.
        position_m: (N,) position of the centre along the mainline from the start of the first segment, m (negative on
            the approach); NaN on ramps.
        lane: (N,) lane from the left, 0 the leftmost, so that ramps do not change other lanes' numbers; -1 on ramps.
        speed_mps: (N,) speed, m/s.
        acceleration_mps2: (N,) acceleration, m/s^2.
        length_m: (N,) length of the vehicle, m.
        connected: (N,) whether the vehicle accepts commands.
        probe: (N,) whether the vehicle's speed enters the segment measurements.
        vtype: (N,) row in `drivers.KINDS`.
        fuel_mg_s: (N,) fuel rate of SUMO's emission model, mg/s; NaN if the simulation does not read it.
        departed: Number of vehicles that have entered since the simulation's start, warm-up included.
        arrived: Names of vehicles that left the road in this tick.
        waiting: Number of vehicles that cannot enter yet, because the road is full.
    """

    road: FreewayRoad
    time_s: float
    names: tuple[str, ...]
    position_m: FloatArray
    lane: IntArray
    speed_mps: FloatArray
    acceleration_mps2: FloatArray
    length_m: FloatArray
    connected: BoolArray
    probe: BoolArray
    vtype: IntArray
    fuel_mg_s: FloatArray
    departed: int = 0
    arrived: tuple[str, ...] = ()
    waiting: int = 0

    @cached_property
    def leader(self) -> IntArray:
        """(N,) row of the next vehicle ahead in the same lane of the mainline; -1 if there is none and on ramps."""
        order = np.lexsort((self.position_m, self.lane))
        order = order[self.lane[order] != NO_LANE]
        ahead = np.full(len(self.names), -1, dtype=np.int64)
        same = self.lane[order[1:]] == self.lane[order[:-1]]
        ahead[order[:-1][same]] = order[1:][same]
        return ahead

    @cached_property
    def gap_m(self) -> FloatArray:
        """(N,) gap from the front bumper to the leader's rear bumper, m; infinite without a leader, NaN on ramps."""
        ahead, here = self.leader, np.arange(len(self.names))
        gap = self.position_m[ahead] - self.position_m[here] - (self.length_m[ahead] + self.length_m[here]) / 2
        return np.where(self.lane == NO_LANE, np.nan, np.where(ahead < 0, np.inf, gap))

    @cached_property
    def leader_speed_mps(self) -> FloatArray:
        """(N,) speed of the leader, m/s; NaN without a leader."""
        return np.where(self.leader < 0, np.nan, self.speed_mps[self.leader])

    @cached_property
    def segment(self) -> IntArray:
        """(N,) segment of each vehicle; -1 on ramps, on the approach and beyond the last segment."""
        inside = np.searchsorted(self.road.bounds_m, self.position_m, side="right") - 1
        return np.where((inside >= 0) & (inside < self.road.segments), inside, -1).astype(np.int64)
