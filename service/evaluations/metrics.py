"""Metrics of one evaluation: over all drives, per cell and per drive; JSON and CSV."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.report.spreadsheet import csv_text
from dohyo.service.boards.leaderboard import Entry
from dohyo.service.evaluations.scoring import Drive, estimate, lost_episodes, scores_of, summarise_drives
from dohyo.service.mixed_runs.by_agent import agents_document, drivers_of, meetings_document

_LENGTHS: Final = ("km", "route_m", "driven_m", "duration_s")


def as_document(entry: Entry) -> dict[str, Any]:
    """Summary of all drives and of each cell, in a mixed run also of each agent, then the drives. Plain JSON."""
    return {
        "evaluation": entry.evaluation,
        "agent": entry.agent,
        "version": entry.version,
        "benchmark": entry.benchmark,
        "benchmark_sha256": entry.benchmark_sha256,
        "seeds": list(entry.seeds),
        "all": summarise_drives(entry.drives, lost_episodes(sum(entry.lost.values()), entry.gridlocked)),
        "cells": {cell: _of_cell(entry, cell, drives) for cell, drives in cells_of(entry).items()},
        "agents": agents_document(entry),
        "meetings": meetings_document(entry),
        "drives": [_drive(entry, drive) for drive in entry.drives],
    }


def as_csv(entry: Entry) -> str:
    """A row per drive, one per cell, in a mixed run one per agent, and one for all; the column `row` says which.

    Scores of several drives have intervals, and the number of drives `lost` beside them.
    """
    kinds = [kind.value for kind in InfractionKind]
    names = scores_of(entry.drives)
    scores = [f"{name}{end}" for name in names for end in ("", "_low", "_high")]
    header = [
        "row",
        "cell",
        "scenario",
        "seed",
        "ego",
        "agent",
        "episode",
        "status",
        "drives",
        "lost",
        *_LENGTHS,
        *scores,
        *kinds,
    ]
    return csv_text(header, _rows(entry, names, kinds))


def cells_of(entry: Entry) -> dict[str, list[Drive]]:
    """Drives by the benchmark's cell, in the order of their first drive; a cell that lost all of them has none."""
    cells: dict[str, list[Drive]] = {}
    for drive in entry.drives:
        cells.setdefault(drive.cell, []).append(drive)
    return cells | {cell: [] for cell in entry.lost if cell not in cells}


def _of_cell(entry: Entry, cell: str, drives: Sequence[Drive]) -> dict[str, Any]:
    gridlocked = [drive for drive in entry.gridlocked if drive.cell == cell]
    return summarise_drives(drives, lost_episodes(entry.lost.get(cell, 0), gridlocked))


def _rows(entry: Entry, names: Sequence[str], kinds: Sequence[str]) -> Iterator[list[object]]:
    for drive in entry.drives:
        who: list[object] = [
            "drive",
            drive.cell,
            drive.scenario,
            drive.seed,
            drive.ego,
            entry.driver_of(drive.ego).name,
        ]
        who += [drive.episode, drive.status.value]
        scores = [value for name in names for value in (_finite(drive.score(name)), None, None)]
        counts = [drive.facts["infractions"].get(kind, 0) for kind in kinds]
        yield [*who, 1, 0, *(drive.facts[name] for name in _LENGTHS), *scores, *counts]
    for cell, drives in cells_of(entry).items():
        yield _group("cell", cell, drives, entry.lost.get(cell, 0), names, kinds)
    for driver in drivers_of(entry) if entry.others else ():
        own = [drive for drive in entry.drives if entry.driver_of(drive.ego) == driver]
        yield _group("agent", None, own, entry.lost_of(driver), names, kinds, agent=driver.name)
    yield _group("all", None, entry.drives, sum(entry.lost.values()), names, kinds)


def _group(
    row: str,
    cell: str | None,
    drives: Sequence[Drive],
    lost: int,
    names: Sequence[str],
    kinds: Sequence[str],
    agent: str | None = None,
) -> list[object]:
    estimates = [estimate(name, drives) for name in names]
    scores = [value for one in estimates for value in (one.mean, one.low, one.high)]
    sums = [sum(drive.facts[name] for drive in drives) for name in _LENGTHS]
    counts = [sum(drive.facts["infractions"].get(kind, 0) for drive in drives) for kind in kinds]
    return [row, cell, None, None, None, agent, None, None, len(drives), lost, *sums, *scores, *counts]


def _finite(score: float) -> float | None:
    return score if math.isfinite(score) else None


def _drive(entry: Entry, drive: Drive) -> dict[str, Any]:
    driver = entry.driver_of(drive.ego)
    place: dict[str, Any] = {"agent": driver.agent, "version": driver.version}
    place |= {"episode": drive.episode, "scenario": drive.scenario, "cell": drive.cell, "seed": drive.seed}
    return {**place, **drive.facts}
