"""One run of the benchmark `dissipation`: a morning's congestion under one design of the plan and one forecast.

The chain is the field's, delays included: segment speeds reach the planner up to three minutes late, connected vehicles
report their state once a second, a plan is published once a minute, and vehicles read it as it ages.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from dohyo.agents.forecasting.base import Forecaster
from dohyo.agents.forecasting.registry import load_forecaster
from dohyo.agents.speed_planning.acc import SetPointPolicy
from dohyo.agents.speed_planning.buffer import BufferPolicy, LearnedBuffer, RuleBuffer
from dohyo.agents.speed_planning.fleet import ACCELERATION_BASED, AccBased, Controller, Fleet, Limiter
from dohyo.agents.speed_planning.planner import PUBLISHED_EVERY_S, PlannerConfig, SpeedPlan, SpeedPlanner
from dohyo.evaluation.scores.traffic import OBSERVED_EVERY_S, Outcome, OutcomeWatch
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.measure import LAG_MINUTES, MINUTE_S, PingLog, SegmentFeed
from dohyo.sumo_networks.freeway.process import TICK_S
from dohyo.sumo_networks.freeway.scenario import FreewayScenario
from dohyo.sumo_networks.freeway.simulation import FreewaySimulation
from dohyo.sumo_networks.freeway.world import FreewayWorld

Design = Literal["none", "limit", "rule", "learned"]
Forecast = Literal["none", "persistence", "sa-lstm", "oracle"]
DESIGNS: tuple[str, ...] = get_args(Design)
FORECASTS: tuple[str, ...] = get_args(Forecast)
SetPoints = Literal["none", "plan", "learned"]
OBSERVED_BEFORE_S = 720.0
"""Time of the feed before control begins, s: eight minutes of history and the lag."""


@dataclass(frozen=True, slots=True)
class Arm:
    """Arm of the study.

    Attributes:
        design: No control; the smoothed state as a speed limit; or a buffer besides, by rule or learned.
        forecast: Of the segments: only pings; the last report as the present; a network that brings it up to the
            present; or the true speeds.
        penetration: Share of connected cars; None: the morning's.
    """

    design: Design = "none"
    forecast: Forecast = "none"
    penetration: float | None = None

    @property
    def name(self) -> str:
        """Such as "rule+oracle" or, with another penetration, "rule+oracle@1%"; "none" without control."""
        if self.design == "none":
            return "none"
        share = "" if self.penetration is None else f"@{100.0 * self.penetration:g}%"
        return f"{self.design}+{self.forecast}{share}"

    @property
    def learned(self) -> bool:
        """Whether a part of it was trained; the shipped weights are one training."""
        return self.design == "learned" or self.forecast == "sa-lstm"


@dataclass(frozen=True, slots=True)
class Morning:
    """Time and length of a run, and its fleet.

    Attributes:
        start_s: Time of day at which control and measurement begin.
        duration_s: Duration of both.
        warm_up_s: Time before the feed begins.
        penetration: Share of connected cars.
        acceleration_based: Share of the fleet with FollowerStopper.
        set_points: Source of the other cars' set-points: none, so that the plan is a speed limit for the driver; the
            plan itself; or the learned policy that reads it.
        planner: Settings of the planner.
    """

    start_s: float = 6.75 * 3600
    duration_s: float = 2400.0
    warm_up_s: float = 300.0
    penetration: float = 0.05
    acceleration_based: float = ACCELERATION_BASED
    set_points: SetPoints = "none"
    planner: PlannerConfig = field(default_factory=PlannerConfig)

    def of_arm(self, arm: Arm) -> Morning:
        """The morning with the penetration of an arm."""
        return self if arm.penetration is None else replace(self, penetration=arm.penetration)

    def scenario(self, seed: int) -> FreewayScenario:
        """Scenario with the lead-in during which the feed runs."""
        return FreewayScenario(
            seed=seed,
            start_s=self.start_s - OBSERVED_BEFORE_S,
            duration_s=self.duration_s + OBSERVED_BEFORE_S,
            warm_up_s=self.warm_up_s,
            penetration=self.penetration,
        )


def run(arm: Arm, seed: int, morning: Morning | None = None, forecaster: str | Path = "sa-lstm") -> Outcome:
    """One run; the same arm, seed and morning give the same outcome.

    Args:
        arm: The arm.
        seed: Of the traffic, the feed's errors and the fleet.
        morning: The morning.
        forecaster: Network of the forecast "sa-lstm": shipped, or a file.

    Raises:
        InvalidInputError: The arm needs a trained network that is not there.
        SimulationError: SUMO failed.
    """
    return watched(worlds(arm, seed, (morning or Morning()).of_arm(arm), forecaster))


def watched(driven: Iterable[FreewayWorld]) -> Outcome:
    """Outcome of all traffic in these worlds."""
    watch = OutcomeWatch()
    for world in driven:
        if is_observed(world.time_s):
            watch.observe(world)
    return watch.outcome()


def worlds(arm: Arm, seed: int, morning: Morning, forecaster: str | Path = "sa-lstm") -> Iterator[FreewayWorld]:
    """The worlds of one run, from the beginning of control, tick by tick; see `run`."""
    with FreewaySimulation(morning.scenario(seed), fuel=False) as simulation:
        yield from controlled(LeadIn.driven(simulation, seed, morning.start_s), arm, morning, forecaster)


@dataclass(frozen=True)
class LeadIn:
    """A morning at the moment at which control begins; the same for every arm of a seed.

    Attributes:
        simulation: At that moment.
        seed: Of the fleet.
        feed: Reports of the segments.
        pings: Of the connected vehicles.
        truth: True speeds for the oracle.
    """

    simulation: FreewaySimulation
    seed: int
    feed: SegmentFeed
    pings: PingLog
    truth: Truth

    @classmethod
    def driven(cls, simulation: FreewaySimulation, seed: int, until_s: float) -> LeadIn:
        """Runs a started simulation until a time of day, observed and without control."""
        lead_in = cls(simulation, seed, SegmentFeed(simulation.road, seed), PingLog(), Truth())
        while simulation.world.time_s < until_s:
            lead_in.observe(simulation.world)
            simulation.tick()
        return lead_in

    def observe(self, world: FreewayWorld) -> None:
        """Takes in one world."""
        self.feed.observe(world)
        self.pings.observe(world)
        self.truth.observe(world)


def controlled(
    lead_in: LeadIn, arm: Arm, morning: Morning, forecaster: str | Path = "sa-lstm"
) -> Iterator[FreewayWorld]:
    """Worlds after the lead-in under one arm; the lead-in cannot be used again."""
    simulation = lead_in.simulation
    speeds_now = segment_speeds(arm.forecast, forecaster) if arm.design != "none" else None
    planner = SpeedPlanner(simulation.road, buffer_policy(arm.design), morning.planner)
    fleet = Fleet(lead_in.seed, controller(morning.set_points), morning.acceleration_based)
    plan: SpeedPlan | None = None
    end, due = morning.start_s + morning.duration_s, morning.start_s
    world = simulation.world
    while world.time_s < end:
        lead_in.observe(world)
        if speeds_now is not None and world.time_s >= due:
            plan = planner.publish(
                world.time_s, speeds_now(lead_in.feed, lead_in.truth, world.time_s), lead_in.pings.pings()
            )
            due += PUBLISHED_EVERY_S
        commands = fleet.commands(world, plan) if plan is not None else {}
        simulation.reads_fuel = is_observed(world.time_s + TICK_S)
        world = simulation.tick(commands)
        yield world


def is_observed(time_s: float) -> bool:
    """Whether the outcome is measured at this time of day."""
    return time_s % OBSERVED_EVERY_S < 1e-6


class Truth:
    """Oracle: present mean speed of all vehicles on each segment."""

    def __init__(self) -> None:
        self._world: FreewayWorld | None = None

    def observe(self, world: FreewayWorld) -> None:
        """Takes in one world."""
        self._world = world

    def speeds(self) -> FloatArray:
        """(S,) m/s; NaN on an empty segment."""
        world = self._world
        if world is None:
            raise InvalidInputError("expected `observe` of a world before `speeds`, got none")
        on = world.segment >= 0
        size = world.road.segments
        count = np.bincount(world.segment[on], minlength=size)
        total = np.bincount(world.segment[on], weights=world.speed_mps[on], minlength=size)
        return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


SegmentSpeeds = Callable[[SegmentFeed, Truth, float], "FloatArray | None"]


def segment_speeds(forecast: Forecast, forecaster: str | Path = "sa-lstm") -> SegmentSpeeds:
    """Source of the segments' present speeds for a kind of forecast.

    Raises:
        InvalidInputError: Its network is missing.
    """
    if forecast == "none":
        return lambda feed, truth, time_s: None
    if forecast == "oracle":
        return lambda feed, truth, time_s: truth.speeds()
    if forecast == "persistence":
        return lambda feed, truth, time_s: _last_report(feed, time_s)
    return _Nowcast(load_forecaster(forecaster, exported=True))


def _last_report(feed: SegmentFeed, time_s: float) -> FloatArray:
    """Last reported speed of each segment, of any age."""
    _, rows = feed.reported(time_s)
    last = np.full(feed.road.segments, np.nan)
    for row in rows:
        last = np.where(np.isnan(row), last, row)
    return last


@dataclass(frozen=True)
class _Nowcast:
    """Network's forecast of the present from the last eight reports; persistence until there are eight."""

    forecaster: Forecaster

    def __call__(self, feed: SegmentFeed, truth: Truth, time_s: float) -> FloatArray:
        minutes, rows = feed.reported(time_s)
        if len(rows) < 8 or np.isnan(rows[-8:]).all():
            return _last_report(feed, time_s)
        late = min((time_s - (minutes[-1] + 1) * MINUTE_S) / MINUTE_S, float(LAG_MINUTES))
        return self.forecaster.nowcast(rows, max(late, 0.0), float(minutes[-1] * MINUTE_S))


def controller(set_points: SetPoints) -> Controller:
    """Controller of the cars without FollowerStopper.

    Raises:
        InvalidInputError: The learned one's checkpoint is not there.
    """
    if set_points == "none":
        return Limiter()
    return AccBased(SetPointPolicy.shipped() if set_points == "learned" else None)


def buffer_policy(design: Design) -> BufferPolicy | None:
    """Buffer policy of a design; None without a buffer.

    Raises:
        InvalidInputError: The learned one's checkpoint is not there.
    """
    if design == "rule":
        return RuleBuffer()
    return LearnedBuffer.shipped() if design == "learned" else None
