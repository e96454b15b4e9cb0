"""Benchmark: a versioned list of scenarios with its scoring, read from TOML."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from dohyo.evaluation.benchmarks.documents import with_cells
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.benchmarks.loading import load
from dohyo.evaluation.families import Family
from dohyo.sumo_networks.events import Event
from dohyo.sumo_networks.events.auto_events import EVERY_M
from dohyo.sumo_networks.scenario import Config, Mission, Name, Scenario, Traffic, content_hash

ENTRY = r"^\w+(\.\w+)*:\w+$"
"""Form of the name of an agent's class."""


class AutoEvents(Config):
    """Automatic placement of scripted events along every mission of a cell, different for every seed.

    Attributes:
        every_m: Smallest and largest distance between the triggers of two events, m.
        kinds: Kinds of event that may be placed; None: all that fit.
    """

    every_m: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]] = EVERY_M
    kinds: Annotated[tuple[str, ...], Field(min_length=1)] | None = None


class Excerpt(Config):
    """A stretch of recorded traffic, and the reference's drive in it.

    Attributes:
        seed: Seed of the traffic, which replaces the seed of the evaluation.
        warm_up_s: Time of traffic before the mission begins, s; replaces that of the cell's traffic.
        reference_m: Progress of the reference, m.
        log: Content hash of the motion of all other actors around the reference.
    """

    seed: Annotated[int, Field(ge=0, lt=2**31)]
    warm_up_s: Annotated[float, Field(ge=0, le=3600)]
    reference_m: Annotated[float, Field(ge=0)]
    log: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class ScriptedMission(Mission):
    """A mission of a benchmark, with the scripted events on it.

    Attributes:
        events: Events given by hand, before those of the cell. Their `ego` is that of this mission.
        excerpt: Recorded traffic in which the mission begins; None: it begins at rest, in any traffic.
    """

    # Left out if there are none, so that benchmarks without events keep their hashes.
    events: Annotated[tuple[Event, ...], Field(exclude_if=lambda events: not events)] = ()
    excerpt: Annotated[Excerpt | None, Field(exclude_if=lambda excerpt: excerpt is None)] = None

    @model_validator(mode="before")
    @classmethod
    def _from_a_plain_one(cls, given: Any) -> Any:
        return dict(given) if isinstance(given, Mission) else given

    def mission(self, name: str) -> Mission:
        """The mission itself, with a name."""
        return Mission(name=name, start=self.start, goal=self.goal, via=self.via, start_speed_mps=self.start_speed_mps)


class Cell(Config):
    """Missions in one traffic under one group of conditions.

    Attributes:
        name: Name, unique in the benchmark.
        network: Name of the network in the catalog.
        missions: Name of the set of missions.
        traffic: Traffic around every mission.
        conditions: Names of conditions, assigned to the missions in turn, so that a cell covers all of them.
        together: Whether all missions are driven at the same time, each by one ego.
        events: "auto": scripted events placed by dohyo along every mission; or the rules of placement; None: only the
            events of the missions.
    """

    name: Name
    network: str
    missions: str
    traffic: Traffic = Traffic()
    conditions: Annotated[tuple[str, ...], Field(min_length=1)] = ("clear",)
    together: bool = False
    events: Annotated[AutoEvents | None, Field(exclude_if=lambda events: events is None)] = None

    @field_validator("events", mode="before")
    @classmethod
    def _auto(cls, given: Any) -> Any:
        return AutoEvents() if given == "auto" else given


class TimeLimit(Config):
    """Time allowed for a mission: that of its route at a steady speed, plus a constant.

    Attributes:
        speed_kmh: Steady speed, km/h.
        extra_s: Constant, s.
    """

    speed_kmh: Annotated[float, Field(gt=0)]
    extra_s: Annotated[float, Field(ge=0)] = 0.0


class Benchmark(Config):
    """A versioned list of scenarios.

    A file may give `network`, `traffic`, `conditions`, `events` and a list of `missions` instead of cells: a single
    cell "all".

    Attributes:
        name: Name in the catalog.
        description: Description in one line, for people.
        headline: Score that ranks agents.
        metric: Computation of that score in words, for people.
        rules: Version of the rules of the driving score.
        cells: Parts of the benchmark.
        missions: Sets of missions by name.
        stop_on_collision: Whether the first collision ends a drive, as in NoCrash.
        time_limit: Time limit of every mission; None: that of the CARLA Leaderboard (see `criteria.route_timeout`).
        seeds: Seeds that are driven by default; (0,) where missions have an excerpt, with a seed of its own.
        duration_s: Duration of every episode, s; None: until the goal.
        replay: Whether all actors except the egos follow the log of the mission's excerpt, even if the egos drive
            differently from it.
        every_condition: Whether each mission is driven under all conditions of its cell instead of one of them in turn.
        reference_agent: "module:Class" of the agent that drives when a log is made.
    """

    name: Name
    description: str
    headline: Headline
    metric: str
    rules: Literal["1.0", "2.0", "2.1"] = "2.0"
    cells: Annotated[tuple[Cell, ...], Field(min_length=1)]
    missions: dict[str, Annotated[tuple[ScriptedMission, ...], Field(min_length=1)]]
    stop_on_collision: bool = False
    time_limit: TimeLimit | None = None
    seeds: Annotated[tuple[int, ...], Field(min_length=1)] = (0, 1, 2)
    duration_s: Annotated[float | None, Field(gt=0, exclude_if=lambda duration: duration is None)] = None
    replay: Annotated[bool, Field(exclude_if=lambda replay: not replay)] = False
    every_condition: Annotated[bool, Field(exclude_if=lambda every: not every)] = False
    reference_agent: Annotated[str | None, Field(pattern=ENTRY, exclude_if=lambda agent: agent is None)] = None

    @model_validator(mode="before")
    @classmethod
    def _one_cell(cls, given: Any) -> Any:
        """Converts the short form of a file to the long form."""
        return with_cells(given) if isinstance(given, dict) else given

    @field_validator("seeds")
    @classmethod
    def _each_seed_once(cls, seeds: tuple[int, ...]) -> tuple[int, ...]:
        if repeated := [seed for seed, times in Counter(seeds).items() if times > 1]:
            raise ValueError(f"expected every seed once, got {repeated[0]} again")
        return seeds

    @model_validator(mode="after")
    def _names_fit(self) -> Benchmark:
        for names in (
            [cell.name for cell in self.cells],
            *[[mission.name for mission in missions] for missions in self.missions.values()],
        ):
            if len(set(names)) != len(names):
                raise ValueError(f"names must be unique, got {names}")
        for cell in self.cells:
            if cell.missions not in self.missions:
                raise ValueError(f"cell '{cell.name}': no set of missions '{cell.missions}'")
        # Records are found by the names of scenarios.
        counts = Counter(name for cell in self.cells for name in self.scenario_names(cell))
        if repeated := [name for name, times in counts.items() if times > 1]:
            raise ValueError(f"expected names of scenarios to be unique, got '{repeated[0]}' again")
        return self

    @model_validator(mode="after")
    def _excerpts_fit(self) -> Benchmark:
        if self.replay and not self.duration_s:
            raise ValueError("replay: expected a duration_s beside it, since logs end")
        if self.replay and not self.reference_agent:
            raise ValueError("replay: expected a reference_agent beside it, which makes missing logs")
        all_have_one = all(mission.excerpt is not None for some in self.missions.values() for mission in some)
        if self.replay and not all_have_one:
            raise ValueError("replay: expected an excerpt in every mission, for its log")
        if self.closed_loop and not all_have_one:
            raise ValueError("headline 'closed_loop': expected an excerpt in every mission, for its reference_m")
        if self.excerpts and self.seeds != (0,):
            raise ValueError("seeds: expected [0], since missions with an excerpt have seeds of their own")
        for cell in self.cells:
            if cell.together and any(mission.excerpt is not None for mission in self.missions[cell.missions]):
                raise ValueError(f"cell '{cell.name}': expected together = false, since its missions have excerpts")
        return self

    @property
    def sha256(self) -> str:
        """Content hash, which is the version. It does not cover default seeds and texts for people."""
        return content_hash(self.model_dump(mode="json", exclude={"seeds", "description", "metric"}))

    @property
    def networks(self) -> tuple[str, ...]:
        """Names of the networks of the cells, in their order."""
        return tuple(dict.fromkeys(cell.network for cell in self.cells))

    def scenarios(self, seeds: Sequence[int]) -> list[Scenario]:
        """One scenario per cell, mission and seed, in the order of the seeds.

        Raises:
            InvalidInputError: A mission cannot be driven or conditions are unknown, and the message names them; or a
                seed is no whole number from 0 to 2^31 - 1, or comes twice.
        """
        from dohyo.evaluation.benchmarks.scenarios import make_scenarios  # reads networks: slow

        return make_scenarios(self, seeds)

    @property
    def size(self) -> int:
        """Number of scenarios for one seed."""
        return sum(len(self.scenario_names(cell)) for cell in self.cells)

    def scenario_names(self, cell: Cell) -> list[str]:
        """Names of the scenarios of a cell for one seed, in their order: mission by mission, then by conditions."""
        names = [cell.name]
        if not cell.together:
            prefix = "" if len(self.cells) == 1 else f"{cell.name}."
            names = [f"{prefix}{mission.name}" for mission in self.missions[cell.missions]]
        if not self.every_condition:
            return names
        return [f"{name}.{conditions}" for name in names for conditions in cell.conditions]

    @property
    def shared_egos(self) -> tuple[str, ...]:
        """Egos of every scenario, which a mixed run may give to different agents; none where an ego drives alone."""
        if not all(cell.together and len(self.missions[cell.missions]) > 1 for cell in self.cells):
            return ()
        names = [[mission.name for mission in self.missions[cell.missions]] for cell in self.cells]
        return tuple(name for name in names[0] if all(name in some for some in names))

    @property
    def excerpts(self) -> bool:
        """Whether the missions begin in recorded traffic."""
        return any(mission.excerpt is not None for missions in self.missions.values() for mission in missions)

    @property
    def closed_loop(self) -> bool:
        """Whether nuPlan's closed-loop score ranks agents."""
        return self.headline is Headline.CLOSED_LOOP


def load_benchmark(name: str) -> Benchmark:
    """Loads a benchmark by its name, or from the path of a .toml file.

    Raises:
        UnknownNameError: No benchmark has this name.
        InvalidInputError: The file is missing or invalid; the message says where.
    """
    return load(name, Family.DRIVING, Benchmark)
