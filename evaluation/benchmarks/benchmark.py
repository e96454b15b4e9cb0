"""Benchmark: a versioned list of scenarios with its scoring, read from TOML."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, field_validator, model_validator

from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.sumo_networks.conditions import conditions_named
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.events import Event
from dohyo.sumo_networks.events.auto_events import EVERY_M, auto_events
from dohyo.sumo_networks.events.director import check_placement, trigger_of
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Config, Mission, Name, Scenario, Traffic, content_hash
from dohyo.sumo_networks.units import KMH_PER_MPS

BENCHMARKS = Path(__file__).parent


class AutoEvents(Config):
    """Scripted events placed by dohyo along every mission of a cell, anew for every seed.

    Attributes:
        every_m: Smallest and largest distance between the triggers of two events, m.
        kinds: Which may come; None: all that fit.
    """

    every_m: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]] = EVERY_M
    kinds: Annotated[tuple[str, ...], Field(min_length=1)] | None = None


class Excerpt(Config):
    """A stretch of traffic, known to the last vehicle, and what the reference did in it.

    Attributes:
        seed: Of the traffic; the mission has no other.
        warm_up_s: After which the mission begins; replaces that of the cell's traffic.
        reference_m: How far the reference came.
        log: Content hash of everybody else's motion around the reference.
    """

    seed: Annotated[int, Field(ge=0, lt=2**31)]
    warm_up_s: Annotated[float, Field(ge=0, le=3600)]
    reference_m: Annotated[float, Field(ge=0)]
    log: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class ScriptedMission(Mission):
    """A mission of a benchmark, with the scripted events on it.

    Attributes:
        events: By hand; they come before those of the cell. Their `ego` is this mission's.
        excerpt: From the midst of which traffic it was taken; None: it begins at rest, in any.
    """

    # Left out where there are none, so that benchmarks without events keep their hashes.
    events: Annotated[tuple[Event, ...], Field(exclude_if=lambda events: not events)] = ()
    excerpt: Annotated[Excerpt | None, Field(exclude_if=lambda excerpt: excerpt is None)] = None

    @model_validator(mode="before")
    @classmethod
    def _from_a_plain_one(cls, given: Any) -> Any:
        return dict(given) if isinstance(given, Mission) else given

    def mission(self, name: str) -> Mission:
        """The mission itself, under a name."""
        return Mission(name=name, start=self.start, goal=self.goal, via=self.via, start_speed_mps=self.start_speed_mps)


class Cell(Config):
    """Missions in one traffic under one group of conditions.

    Attributes:
        name: Unique in the benchmark.
        network: Name in the network catalog.
        missions: Name of a set of missions.
        traffic: Around every mission.
        conditions: Dealt out to the missions in turn, so that a cell covers all of them.
        together: Drive all missions at once, an ego each, instead of one after the other.
        events: "auto": scripted events, placed by dohyo along every mission; or how; None: only those of the missions.
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
    """Time allowed for a mission: that of its route at a steady speed, and a bit.

    Attributes:
        speed_kmh: Steady speed.
        extra_s: The bit.
    """

    speed_kmh: Annotated[float, Field(gt=0)]
    extra_s: Annotated[float, Field(ge=0)] = 0.0


class Benchmark(Config):
    """A versioned list of scenarios.

    A file may give `network`, `traffic`, `conditions`, `events` and a list of `missions` instead of cells: a single
    cell "all".

    Attributes:
        name: In the catalog.
        description: One line for people.
        headline: The score that ranks agents.
        metric: For people: how that score is computed here.
        rules: Of the driving score.
        cells: Its parts.
        missions: Sets of missions by name.
        stop_on_collision: As in NoCrash.
        time_limit: None: the CARLA Leaderboard's (see `dohyo.evaluation.criteria.timeout`).
        seeds: Driven by default; missions with an excerpt have their own.
        duration_s: Of every episode; None: to the goal.
        replay: Everybody but the egos replays the log of the mission's excerpt, whatever the egos do.
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

    @model_validator(mode="before")
    @classmethod
    def _one_cell(cls, given: Any) -> Any:
        """Turns the short form of a file into the long one."""
        if not isinstance(given, dict) or "cells" in given or not isinstance(given.get("missions"), list | tuple):
            return given
        parts = {key: given[key] for key in ("network", "traffic", "conditions", "events") if key in given}
        rest = {key: value for key, value in given.items() if key not in parts}
        return rest | {"cells": [{"name": "all", "missions": "all", **parts}], "missions": {"all": given["missions"]}}

    @model_validator(mode="after")
    def _names_fit(self) -> Benchmark:
        for names in (
            [cell.name for cell in self.cells],
            *[[mission.name for mission in missions] for missions in self.missions.values()],
        ):
            if len(set(names)) != len(names):
                raise ValueError(f"names must be unique, got {names}")
        if self.replay and not self.duration_s:
            raise ValueError("replay: expected a duration_s beside it, since logs end")
        missions = [mission for some in self.missions.values() for mission in some]
        if self.closed_loop and any(mission.excerpt is None for mission in missions):
            raise ValueError("headline 'closed_loop': expected an excerpt in every mission, for its reference_m")
        for cell in self.cells:
            if cell.missions not in self.missions:
                raise ValueError(f"cell '{cell.name}': no set of missions '{cell.missions}'")
        return self

    @property
    def sha256(self) -> str:
        """Content hash: its version. Default seeds and the texts for people are no part of it."""
        return content_hash(self.model_dump(mode="json", exclude={"seeds", "description", "metric"}))

    @property
    def networks(self) -> tuple[str, ...]:
        """Names of the networks it uses, in the order of the cells."""
        return tuple(dict.fromkeys(cell.network for cell in self.cells))

    def scenarios(self, seeds: Sequence[int]) -> list[Scenario]:
        """One scenario per cell, mission and seed, seed by seed.

        Raises:
            InvalidInputError: A mission cannot be driven or conditions are unknown; the message says which.
        """
        if self.excerpts and list(seeds) != [0]:
            raise InvalidInputError(
                f"the missions of benchmark '{self.name}' have seeds of their own; leave out --seeds"
            )
        return [scenario for seed in seeds for cell in self.cells for scenario in self._scenarios(cell, seed)]

    @property
    def excerpts(self) -> bool:
        """Whether its missions begin in the midst of traffic."""
        return any(mission.excerpt is not None for missions in self.missions.values() for mission in missions)

    @property
    def closed_loop(self) -> bool:
        """Whether it ranks by nuPlan's closed-loop score."""
        return self.headline is Headline.CLOSED_LOOP

    def _scenarios(self, cell: Cell, seed: int) -> Iterator[Scenario]:
        missions = self.missions[cell.missions]
        lengths = [self._length(cell, number, mission) for number, mission in enumerate(missions, start=1)]
        if cell.together:
            egos = tuple(mission.mission(mission.name) for mission in missions)
            events = [
                event
                for number, mission in enumerate(missions)
                for event in self._events(cell, number, mission, mission.name, seed, together=True)
            ]
            conditions = cell.conditions[seed % len(cell.conditions)]
            yield self._scenario(cell, cell.name, egos, events, conditions, max(lengths), seed)
            return
        for number, (mission, length) in enumerate(zip(missions, lengths, strict=True)):
            name = mission.name if len(self.cells) == 1 else f"{cell.name}.{mission.name}"
            conditions = cell.conditions[number % len(cell.conditions)]
            events = self._events(cell, number, mission, "ego", seed, together=False)
            scenario = self._scenario(cell, name, (mission.mission("ego"),), events, conditions, length, seed)
            yield scenario if mission.excerpt is None else self._excerpted(scenario, mission.excerpt)

    def _excerpted(self, scenario: Scenario, excerpt: Excerpt) -> Scenario:
        warmed_up = scenario.traffic.model_copy(update={"warm_up_s": excerpt.warm_up_s})
        return scenario.model_copy(
            update={
                "seed": excerpt.seed,
                "traffic": warmed_up,
                "duration_s": self.duration_s,
                "reference_m": excerpt.reference_m,
                "log": excerpt.log if self.replay else None,
            }
        )

    def _events(
        self, cell: Cell, number: int, mission: ScriptedMission, ego: str, seed: int, *, together: bool
    ) -> list[Event]:
        """The events on one mission: those given by hand, checked, then those of the cell that keep away from them."""
        if not mission.events and cell.events is None:
            return []
        network, route = load_network(cell.network), _route(cell.network, mission.mission(mission.name))
        changes = (lambda event: {"ego": ego, "name": f"{ego}-{event.name}"}) if together else (lambda _: {"ego": None})
        found = [event.model_copy(update=changes(event)) for event in mission.events]
        try:
            for event in found:
                check_placement(event, ego, network, route)
            if cell.events is not None:
                drawn = int(np.random.SeedSequence(seed, spawn_key=(number,)).generate_state(1)[0])
                auto = cell.events
                placed = auto_events(network, route, drawn, auto.kinds, auto.every_m, ego if together else None)
                by_hand = [trigger_of(event, network, route) for event in found]
                found += [
                    event
                    for event in placed
                    if all(abs(trigger_of(event, network, route) - at) >= auto.every_m[0] for at in by_hand)
                ]
        except InvalidInputError as error:
            raise InvalidInputError(f"benchmark '{self.name}', mission {number + 1}: {error}") from error
        names = [event.name for event in found]
        if len(set(names)) != len(names):
            raise InvalidInputError(
                f"benchmark '{self.name}', mission {number + 1}: event names must be unique, got {names}"
            )
        return found

    def _length(self, cell: Cell, number: int, mission: ScriptedMission) -> float:
        try:
            return _route(cell.network, mission.mission(mission.name)).length
        except InvalidInputError as error:
            raise InvalidInputError(f"benchmark '{self.name}', mission {number}: {error}") from error

    def _scenario(
        self,
        cell: Cell,
        name: str,
        missions: tuple[Mission, ...],
        events: Sequence[Event],
        conditions: str,
        longest: float,
        seed: int,
    ) -> Scenario:
        conditions_named(conditions)
        limit = self.time_limit
        return Scenario(
            name=name,
            cell=cell.name,
            network=cell.network,
            missions=missions,
            traffic=cell.traffic,
            conditions=conditions,
            events=tuple(events),
            stop_on_collision=self.stop_on_collision,
            time_limit_s=round(longest / (limit.speed_kmh / KMH_PER_MPS) + limit.extra_s, 1) if limit else None,
            seed=seed,
        )


@cache
def _route(network: str, mission: Mission) -> Route:
    return plan_route(load_network(network), mission)


def _document(path: Path) -> dict[str, Any]:
    """A file's tables; where it is `like` another one beside it, what it does not say is said there."""
    document = tomllib.loads(path.read_text())
    if (like := document.pop("like", None)) is None:
        return document
    return _document(path.with_name(f"{like}.toml")) | document


def benchmark_names() -> list[str]:
    """Names of the benchmarks that come with dohyo, sorted."""
    return sorted(path.stem for path in BENCHMARKS.glob("*.toml"))


def load_benchmark(name: str) -> Benchmark:
    """A benchmark by name, or from a path of a .toml file.

    Raises:
        UnknownNameError: No such name.
        InvalidInputError: The file is missing or broken; the message says where.
    """
    path = Path(name) if name.endswith(".toml") else BENCHMARKS / f"{name}.toml"
    if not name.endswith(".toml") and name not in benchmark_names():
        raise UnknownNameError("benchmark", name, benchmark_names())
    try:
        return Benchmark.model_validate(_document(path))
    except OSError as error:
        raise InvalidInputError(f"cannot read benchmark file '{path}': {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"benchmark file '{path}' is no TOML: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InvalidInputError(f"benchmark file '{path}': {where or 'file'}: {first['msg']}") from error
