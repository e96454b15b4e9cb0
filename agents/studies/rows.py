"""Rows: results of a study, one JSON object per cell; JSON lines in a file, or in all .jsonl files of a folder.

A row has the five fields of its `Cell` and its measures. The row of a lost cell has only the reason, as "lost".
"""

from __future__ import annotations

import json
import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.crossed_bootstrap import Matched
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import read_lines

Row = dict[str, Any]


def read_rows(path: Path) -> list[Row]:
    """Rows of a file, or of all files of a folder in the order of their names; without a torn last line.

    Raises:
        InvalidInputError: A row has no cell.
    """
    rows = [row for file in (sorted(path.glob("*.jsonl")) if path.is_dir() else [path]) for row in read_lines(file)]
    for row in rows:
        if missing := [name for name in Cell._fields if name not in row]:
            raise InvalidInputError(f"'{path}': expected rows with {', '.join(missing)}, got {json.dumps(row)[:120]}")
    return rows


def cell_of(row: Row) -> Cell:
    """Cell of a row."""
    return Cell(*(row[name] for name in Cell._fields))


def is_lost(row: Row) -> bool:
    """Whether the cell was lost: by the machine, or in a gridlock of the traffic. Lost cells are in no mean."""
    return "lost" in row or str(row.get("status", "")).startswith("lost")


def of_one_training(rows: Iterable[Row], trained: Collection[str]) -> list[Row]:
    """Rows of arms whose shipped weights have a part in them, as those of one training; others may differ."""
    return [{**row, "training_seed": 0} if row["arm"] in trained else row for row in rows]


def matched(rows: Iterable[Row], arm: str, measure: str) -> Matched:
    """Values of a measure in an arm, by scenario and training; without lost cells, and rows whose value is None."""
    found: dict[tuple[Any, ...], dict[int | None, float]] = {}
    for row in rows:
        if row["arm"] == arm and not is_lost(row) and row[measure] is not None:
            key = (row["benchmark"], row["scenario"], row["seed"])
            found.setdefault(key, {})[row["training_seed"]] = float(row[measure])
    return found


def grouped(rows: Iterable[Row], field: str) -> dict[Any, list[Row]]:
    """Rows by the value of a field, in the order of the rows."""
    found: dict[Any, list[Row]] = {}
    for row in rows:
        found.setdefault(row[field], []).append(row)
    return found


def by_arm(rows: Iterable[Row], order: Iterable[str]) -> dict[str, list[Row]]:
    """Rows of each arm that has some, in a given order of the arms."""
    found = grouped(rows, "arm")
    return {arm: found[arm] for arm in order if arm in found}


def by_place(rows: Iterable[Row], order: Iterable[str]) -> Iterator[tuple[str, str, list[Row]]]:
    """Benchmark, arm and their rows: benchmarks in the order of the rows, arms in a given one."""
    for where, there in grouped(rows, "benchmark").items():
        for arm, own in by_arm(there, order).items():
            yield where, arm, own


def infractions_per_km(rows: Iterable[Row]) -> tuple[float, Mapping[str, float]]:
    """Kilometres of some drives together, at least a metre, and their infractions per km by kind; 0 of other kinds."""
    driven = list(rows)
    km = max(math.fsum(row["driven_m"] for row in driven) / 1000.0, 1e-3)
    total = Counter[str]()
    for row in driven:
        total.update(row["infractions"])
    return km, defaultdict(float, {kind: count / km for kind, count in total.items()})
