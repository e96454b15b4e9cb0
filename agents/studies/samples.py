"""Samples: the scenarios of a benchmark that a study drives, the same for every arm."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache

from dohyo.agents.studies.arms import Cell, Place
from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.benchmarks.part import in_drawing_order
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Scenario


@dataclass(frozen=True, slots=True)
class Sample:
    """Scenarios of a benchmark, chosen by their cells, numbers and types.

    Attributes:
        benchmark: Name of the benchmark.
        cells: Prefixes of names of cells; empty: all.
        seed: Seed of the scenarios; excerpts have their own.
        remainder: Remainder of the mission's number by 2; None: all. Planners are developed on odd missions.
        per_type: Most scenarios of a type, the first part of a cell's name: those whose names have the smallest hashes.
        every: Every n-th of the scenarios that are left.
    """

    benchmark: str
    cells: tuple[str, ...] = ()
    seed: int = 0
    remainder: int | None = None
    per_type: int | None = None
    every: int = 1

    def scenarios(self) -> list[Scenario]:
        """The scenarios, in the order of the benchmark.

        Raises:
            UnknownNameError: There is no such benchmark.
            InvalidInputError: No scenario is left.
        """
        found = [
            one
            for one in _benchmark(self.benchmark).scenarios([self.seed])
            if (not self.cells or one.cell.startswith(self.cells))
            and (self.remainder is None or _number(one) % 2 == self.remainder)
        ]
        if self.per_type is not None:
            kept = _fewest(found, self.per_type)
            found = [one for one in found if one.name in kept]
        if not found:
            raise InvalidInputError(f"benchmark '{self.benchmark}' has no scenario in cells {', '.join(self.cells)}")
        return found[:: self.every]

    def other_half(self) -> Sample:
        """The same of the missions with the other remainder."""
        return self if self.remainder is None else replace(self, remainder=1 - self.remainder)

    def places(self) -> list[Place]:
        """The scenarios as places of cells."""
        return [Place(self.benchmark, one.name, one.seed) for one in self.scenarios()]


def places_of(samples: Iterable[Sample]) -> list[Place]:
    """Places of several samples, one after the other."""
    return [place for sample in samples for place in sample.places()]


def scenario_of(cell: Cell) -> Scenario:
    """Scenario of a cell."""
    seed = 0 if _benchmark(cell.benchmark).excerpts else cell.seed or 0
    return _by_name(cell.benchmark, seed)[cell.scenario]


@cache
def _benchmark(name: str) -> Benchmark:
    return load_benchmark(name)


@cache
def _by_name(benchmark: str, seed: int) -> dict[str, Scenario]:
    return {one.name: one for one in _benchmark(benchmark).scenarios([seed])}


def _number(scenario: Scenario) -> int:
    """Number of the mission, which only the names of numbered missions have, such as "m12"."""
    digits = scenario.name.rpartition(".m")[2]
    if not digits.isdecimal():
        raise InvalidInputError(f"scenario '{scenario.name}': expected a numbered mission, such as m12")
    return int(digits)


def _fewest(scenarios: Iterable[Scenario], count: int) -> set[str]:
    types: dict[str, list[str]] = {}
    for one in scenarios:
        types.setdefault(one.cell.partition(".")[0], []).append(one.name)
    return {name for names in types.values() for name in in_drawing_order(names)[:count]}
