"""Effects of a control on all traffic: throughput, mean and deviation of speed, fuel, headways."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.freeway.energy import fuel_rates
from dohyo.sumo_networks.freeway.world import FreewayWorld

OBSERVED_EVERY_S = 1.0
MOVING_MPS = 1.0
"""Smallest speed of a vehicle whose headway counts, m/s."""
CLOSE_S = 2.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of one run, over all vehicles between the first segment's start and the last one's end.

    Attributes:
        throughput_vph: Number of vehicles per hour that drove into the bottleneck.
        speed_mps: Mean speed over vehicles and seconds, m/s.
        speed_std_mps: Standard deviation of speed over vehicles and seconds, m/s.
        speed_std_within_mps: Standard deviation within each minute (root mean square over minutes), which drivers
            notice, m/s.
        travelled_km: Distance driven by all vehicles, km.
        fuel_sumo_g_km: Fuel by SUMO's emission model, g/km.
        fuel_circles_g_km: Fuel by the CIRCLES model, with every vehicle as a mid-size SUV, g/km.
        least_headway_s: Smallest time gap of a vehicle above 1 m/s, s.
        least_ttc_s: Smallest time to collision, s.
        collisions: Number of pairs of vehicles in one lane that ever overlapped.
        close_share: Share of vehicle seconds with a time to collision below 2 s, in [0, 1].
        waiting: Number of vehicles that could not enter by the end, because the road was full.
    """

    throughput_vph: float
    speed_mps: float
    speed_std_mps: float
    speed_std_within_mps: float
    travelled_km: float
    fuel_sumo_g_km: float
    fuel_circles_g_km: float
    least_headway_s: float
    least_ttc_s: float
    collisions: int
    close_share: float
    waiting: int

    def as_dict(self) -> dict[str, float]:
        """The numbers by name, for JSON."""
        return asdict(self)


class PassageCount:
    """Counts the vehicles that drive into the bottleneck."""

    def __init__(self) -> None:
        self._before: set[str] = set()

    def observe(self, world: FreewayWorld) -> int:
        """Number of vehicles that passed since the last call; to be called once per second.

        A vehicle has passed if it was at most 100 m before the bottleneck a second ago and is at most 100 m beyond it.
        """
        away = world.position_m - world.road.bottleneck_m
        beyond = {world.names[row] for row in np.flatnonzero((away >= 0) & (away < 100))}
        passed = len(self._before & beyond)
        self._before = {world.names[row] for row in np.flatnonzero((away < 0) & (away > -100))}
        return passed


class OutcomeWatch:
    """Accumulates worlds into an outcome."""

    def __init__(self) -> None:
        self._seconds = self._passed = self._close = self._waiting = 0
        self._minutes: dict[int, FloatArray] = {}  # count, sum and sum of squares of speeds
        self._fuel = np.zeros(2)
        self._metres = 0.0
        self._least = np.full(2, np.inf)
        self._passage = PassageCount()
        self._touched: set[tuple[str, str]] = set()

    def observe(self, world: FreewayWorld) -> None:
        """Adds one world; to be called once per second."""
        on = world.segment >= 0
        speed = world.speed_mps[on]
        sums = np.array([len(speed), speed.sum(), (speed**2).sum()])
        minute = int(world.time_s // 60)
        self._minutes[minute] = self._minutes.get(minute, np.zeros(3)) + sums
        self._metres += float(speed.sum()) * OBSERVED_EVERY_S
        self._fuel += np.nansum(world.fuel_mg_s[on]) / 1000, fuel_rates(speed, world.acceleration_mps2[on]).sum()
        self._follow(world.gap_m[on], speed, world.leader_speed_mps[on])
        self._touch(world)
        self._passed += self._passage.observe(world)
        self._seconds += 1
        self._waiting = world.waiting

    def outcome(self) -> Outcome:
        """The outcome of all worlds so far."""
        sums = np.array(list(self._minutes.values())).reshape(-1, 3)
        count, total, squares = sums.sum(axis=0)
        mean = total / max(count, 1)
        within = (sums[:, 2] - sums[:, 1] ** 2 / np.maximum(sums[:, 0], 1)).sum() / max(count, 1)
        km = self._metres / 1000
        return Outcome(
            throughput_vph=self._passed * 3600 / max(self._seconds * OBSERVED_EVERY_S, 1),
            speed_mps=float(mean),
            speed_std_mps=float(np.sqrt(max(squares / max(count, 1) - mean**2, 0))),
            speed_std_within_mps=float(np.sqrt(max(within, 0))),
            travelled_km=km,
            fuel_sumo_g_km=float(self._fuel[0]) / max(km, 1e-9),
            fuel_circles_g_km=float(self._fuel[1]) / max(km, 1e-9),
            least_headway_s=float(self._least[0]),
            least_ttc_s=float(self._least[1]),
            collisions=len(self._touched),
            close_share=self._close / max(float(count), 1.0),
            waiting=self._waiting,
        )

    def _follow(self, gap: FloatArray, speed: FloatArray, leader: FloatArray) -> None:
        there = np.isfinite(gap)
        gap, speed, leader = np.maximum(gap[there], 0.0), speed[there], leader[there]
        moving = speed > MOVING_MPS
        if moving.any():
            self._least[0] = min(self._least[0], float((gap[moving] / speed[moving]).min()))
        closing = speed - leader > 0.1
        if closing.any():
            ttc = gap[closing] / (speed - leader)[closing]
            self._least[1] = min(self._least[1], float(ttc.min()))
            self._close += int(np.count_nonzero(ttc < CLOSE_S))

    def _touch(self, world: FreewayWorld) -> None:
        for row in np.flatnonzero((world.gap_m < 0) & (world.segment >= 0)).tolist():
            self._touched.add((world.names[row], world.names[world.leader[row]]))
