"""Rows: results of a study, one JSON object per cell; JSON lines in a file, or in all .jsonl files of a folder.

A row has the five fields of its `Cell` and its measures. The row of a lost cell has only the reason, as "lost".
"""

from __future__ import annotations

import json
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
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


def matched(rows: Iterable[Row], arm: str, measure: str) -> Matched:
    """Values of a measure in an arm, by scenario and training; without lost cells."""
    found: dict[tuple[Any, ...], dict[int | None, float]] = {}
    for row in rows:
        if row["arm"] == arm and not is_lost(row):
            key = (row["benchmark"], row["scenario"], row["seed"])
            found.setdefault(key, {})[row["training_seed"]] = float(row[measure])
    return found


def arms_in(rows: Iterable[Row], order: Sequence[str]) -> list[str]:
    """Arms that have rows, in a given order."""
    there = {row["arm"] for row in rows}
    return [arm for arm in order if arm in there]


def infractions_per_km(rows: Iterable[Row]) -> tuple[float, Mapping[str, float]]:
    """Kilometres of some drives together, at least a metre, and their infractions per km by kind; 0 of other kinds."""
    driven = list(rows)
    km = max(math.fsum(row["driven_m"] for row in driven) / 1000.0, 1e-3)
    total = Counter[str]()
    for row in driven:
        total.update(row["infractions"])
    return km, defaultdict(float, {kind: count / km for kind, count in total.items()})


def named(rows: Iterable[Row], field: str) -> list[Any]:
    """Different values of a field, in the order of the rows."""
    return list(dict.fromkeys(row[field] for row in rows))
