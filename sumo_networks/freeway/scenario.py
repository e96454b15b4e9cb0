"""FreewayScenario: a part of one day on the freeway, with everything needed to replay it."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.freeway.road import FreewayRoad

DAY_S = 86400.0
WEEKEND = (5, 6)
INCIDENTS_PER_DAY = 0.25


class Incident(Config):
    """A vehicle that breaks down and blocks its lane.

    Its car departs in time to arrive at 28 m/s. In free flow it stops up to a minute before the expected time, behind a
    queue minutes after it.

    Attributes:
        time_s: Expected time of the breakdown, s since midnight.
        duration_s: Time for which the lane is blocked, from the stop of the car on, s.
        position_m: Position from the start of the first segment, m.
        lane: Number of the lane from the left, 0 the leftmost.
    """

    time_s: Annotated[float, Field(ge=0)]
    duration_s: Annotated[float, Field(gt=0)]
    position_m: float
    lane: Annotated[int, Field(ge=0)]


class Day(Config):
    """Properties in which days differ.

    Attributes:
        weekday: 0 Monday to 6 Sunday.
        demand: Factor on all flows.
        peak_shift_s: Delay of the morning peak, s.
        peak_width: Factor on the duration of the peak.
        trucks: Share of trucks among the vehicles.
        tau_factor: Factor on every driver's time gap: above 1 on a wet or dark morning.
        incidents: Breakdowns of the day; those before the beginning of a simulation are not in it.
    """

    weekday: Annotated[int, Field(ge=0, le=6)] = 1
    demand: Annotated[float, Field(gt=0, le=2)] = 1.0
    peak_shift_s: float = 0.0
    peak_width: Annotated[float, Field(gt=0)] = 1.0
    trucks: Annotated[float, Field(ge=0, le=0.5)] = 0.06
    tau_factor: Annotated[float, Field(ge=0.8, le=1.5)] = 1.0
    incidents: tuple[Incident, ...] = ()


class FreewayScenario(Config):
    """A part of one day on the freeway.

    Attributes:
        network: Catalog name of a freeway.
        seed: Seed of departures, driver types, and the errors of SUMO's drivers.
        day: Properties of the day.
        start_s: Time of day at which the reported time begins, s since midnight.
        duration_s: Duration of the demand from `start_s` on, s.
        warm_up_s: Time simulated before the start, so that the road is full then, s.
        penetration: Share of the cars that are connected. It changes nothing else: the same seed gives the same
            vehicles at the same times for every penetration.
        probes: Share of the vehicles whose speeds enter the segment measurements.
    """

    network: str = "freeway"
    seed: Annotated[int, Field(ge=0)] = 0
    day: Day = Day()
    start_s: Annotated[float, Field(ge=0, lt=DAY_S)] = 6.0 * 3600
    duration_s: Annotated[float, Field(gt=0, le=DAY_S)] = 3600.0
    warm_up_s: Annotated[float, Field(ge=0)] = 600.0
    penetration: Annotated[float, Field(ge=0, le=1)] = 0.0
    probes: Annotated[float, Field(ge=0, le=1)] = 0.1

    @model_validator(mode="after")
    def _one_day(self) -> FreewayScenario:
        if self.start_s + self.duration_s > DAY_S:
            raise ValueError(f"expected an end before midnight, got {self.start_s:g} s + {self.duration_s:g} s")
        return self


def draw_day(weekday: int, seed: np.random.SeedSequence, road: FreewayRoad) -> Day:
    """Draws a random day: its demand, peak, weather and incidents.

    Args:
        weekday: 0 Monday to 6 Sunday.
        seed: Seed of the day.
        road: Freeway of the incidents.
    """
    rng = np.random.default_rng(seed)
    habit = (1.0, 1.02, 1.02, 1.01, 0.95, 1.0, 1.0)[weekday]
    wet = rng.random() < 0.15
    return Day(
        weekday=weekday,
        demand=float(np.clip(habit * rng.normal(1.0, 0.035), 0.85, 1.12)),
        peak_shift_s=float(np.clip(rng.normal(0.0, 600.0), -1500, 1500)),
        peak_width=float(np.clip(rng.normal(1.0, 0.08), 0.8, 1.25)),
        trucks=float(np.clip(rng.normal(0.03 if weekday in WEEKEND else 0.07, 0.01), 0.01, 0.12)),
        tau_factor=float(rng.uniform(1.03, 1.10)) if wet else 1.0,
        incidents=tuple(_incident(rng, road) for _ in range(rng.poisson(INCIDENTS_PER_DAY))),
    )


def _incident(rng: np.random.Generator, road: FreewayRoad) -> Incident:
    """Draws an incident: mostly by day, for 10 to 40 minutes, on one of the outer lanes."""
    time_s, duration_s = rng.triangular(5.0, 9.0, 20.0) * 3600, rng.uniform(600, 2400)
    position_m = float(rng.uniform(0.1, 0.95) * road.bounds_m[-1])
    segment = int(np.searchsorted(road.bounds_m, position_m, side="right")) - 1
    lane = int(rng.choice((0, road.lanes[segment] - 1)))
    return Incident(time_s=float(time_s), duration_s=float(duration_s), position_m=position_m, lane=lane)
