"""Part of a benchmark: missions chosen by name, or a sample of them that is the same everywhere."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.scenario import Scenario


def select(scenarios: Sequence[Scenario], only: Sequence[str] = (), sample: int | None = None) -> list[Scenario]:
    """The scenarios of chosen missions, in the order given; a mission is kept with all of its seeds.

    Args:
        scenarios: Scenarios of one benchmark, for any seeds.
        only: Names of cells ("town-test.dense"), of missions ("left-to-south") or of a cell's missions
            ("town-test.dense.m3"), or patterns of such names ("town-test.*"); empty: all.
        sample: Number of missions to draw from those, see `sample_missions`; None: all.

    Raises:
        UnknownNameError: No cell or mission has one of the names.
        InvalidInputError: The sample is larger than the number of missions.
    """
    names = {one.name: names_of(one) for one in scenarios}
    for pattern in only:
        if not any(_matches(some, pattern) for some in names.values()):
            raise UnknownNameError("cell or mission", pattern, set().union(*names.values()))
    chosen = [one for one in scenarios if not only or any(_matches(names[one.name], pattern) for pattern in only)]
    if sample is not None:
        drawn = sample_missions({one.name: one.cell for one in chosen}, sample)
        chosen = [one for one in chosen if one.name in drawn]
    return chosen


def sample_missions(cells: dict[str, str], count: int) -> set[str]:
    """Draws missions, from every cell in proportion to its size.

    Missions are drawn in the order of the SHA-256 of their names. So there is no seed to choose, the sample is the same
    on all machines and for all agents, and a larger sample contains each smaller one.

    Args:
        cells: Cell of every mission, by the mission's name.
        count: Number of missions.

    Raises:
        InvalidInputError: There are fewer missions.
    """
    if not 0 < count <= len(cells):
        raise InvalidInputError(f"sample: expected 1 to {len(cells)} missions, got {count}")
    sizes, drawn = Counter(cells.values()), Counter[str]()
    places = {}
    for name in in_drawing_order(cells):
        cell = cells[name]
        places[name] = (drawn[cell] + 0.5) / sizes[cell]  # where the mission stands in its cell, in (0, 1)
        drawn[cell] += 1
    return set(sorted(places, key=places.__getitem__)[:count])


def in_drawing_order(names: Iterable[str]) -> list[str]:
    """Names in the order of their SHA-256, in which samples are drawn."""
    return sorted(names, key=lambda name: hashlib.sha256(name.encode()).digest())


def names_of(scenario: Scenario) -> set[str]:
    """Names under which a scenario can be chosen: its cell, and its mission with or without cell and conditions."""
    within_cell = scenario.name.removeprefix(f"{scenario.cell}.")
    mission = within_cell.removesuffix(f".{scenario.conditions}")
    return {scenario.cell, scenario.name, within_cell, mission, f"{scenario.cell}.{mission}"}


def _matches(names: set[str], pattern: str) -> bool:
    return any(fnmatchcase(name, pattern) for name in names)
