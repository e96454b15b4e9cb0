"""Rows of the league: one JSON object per drive, lot, day or morning, checked against the edition.

The league writes its files whole, so that a line that cannot be read is damage, and no line that is being written.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from dohyo.agents.league.edition import Discipline, Edition
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row, cell_of, is_lost
from dohyo.agents.studies.study import FACTS
from dohyo.evaluation.families import Family
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.errors import InvalidInputError


def read_league_rows(edition: Edition, path: Path) -> list[Row]:
    """Rows of a file, or of all files of a folder in the order of their names; empty if there are none.

    Raises:
        InvalidInputError: A row is damaged, comes twice, or is not of the edition.
    """
    if (other := _facts(path).get("edition", edition.name)) != edition.name:
        raise InvalidInputError(f"'{path}': expected rows of edition '{edition.name}', got ones of '{other}'")
    found: dict[Cell, Row] = {}
    for where, text in _lines(path):
        row = _object(where, text)
        if problem := _problem(edition, row):
            raise InvalidInputError(f"{where}: {problem}")
        if (cell := cell_of(row)) in found:
            raise InvalidInputError(f"{where}: {_told(cell)} comes twice")
        found[cell] = row
    return [*found.values()]


def versions_of(path: Path, rows: Iterable[Row]) -> set[str]:
    """Versions of dohyo that drove rows of a file or folder; empty where nothing is told of them.

    Raises:
        InvalidInputError: The facts beside the rows are damaged.
    """
    wanted = {f"{row['benchmark']}/{row['arm']}" for row in rows}
    try:
        return {one["versions"]["dohyo"] for name, one in _facts(path)["evaluations"].items() if name in wanted}
    except (KeyError, TypeError, AttributeError) as error:
        raise InvalidInputError(f"'{path}': expected versions of evaluations in {FACTS}, got none") from error


def check_version(path: Path, rows: Iterable[Row]) -> None:
    """Refuses rows of another version of dohyo, since a record's hash holds the version.

    Raises:
        InvalidInputError: There are such rows.
    """
    here = version("dohyo")
    if others := versions_of(path, rows) - {here}:
        raise InvalidInputError(
            f"'{path}': expected rows that were driven with dohyo {here}, got ones of {', '.join(sorted(others))}, "
            "whose records have other hashes; install that version for them"
        )


def _facts(path: Path) -> dict[str, Any]:
    """What is told beside the rows of a file or folder: edition and evaluations."""
    facts = (path if path.is_dir() else path.parent) / FACTS
    if not facts.is_file():
        return {"evaluations": {}}
    return _object(f"'{facts}'", facts.read_text(errors="replace"))


def read_comparable_rows(edition: Edition, path: Path) -> list[Row]:
    """Rows as `read_league_rows` reads them, of entrants that drove the same scenarios in each discipline.

    Raises:
        InvalidInputError: There are no rows, one is unusable, or an entrant has fewer scenarios than another one.
    """
    rows = read_league_rows(edition, path)
    if not rows:
        raise InvalidInputError(f"'{path}': expected rows of the league, found none")
    for discipline in edition.disciplines:
        _check_same(path, discipline, [row for row in rows if row["benchmark"] == discipline.name])
    return rows


def _check_same(path: Path, discipline: Discipline, rows: Sequence[Row]) -> None:
    scenarios = {(row["scenario"], row["seed"]) for row in rows}
    for arm in dict.fromkeys(row["arm"] for row in rows):
        own = {(row["scenario"], row["seed"]) for row in rows if row["arm"] == arm}
        if missing := sorted(scenarios - own, key=str):
            name, seed = missing[0]
            raise InvalidInputError(
                f"'{path}': expected the scenarios of all entrants in {discipline.name}, "
                f"and {arm} has {len(own)} of {len(scenarios)} (not {name} s{seed}); drive it again"
            )


def _lines(path: Path) -> Iterator[tuple[str, str]]:
    for file in sorted(path.glob("*.jsonl")) if path.is_dir() else [path]:
        try:
            text = file.read_text()
        except (OSError, UnicodeDecodeError) as error:
            raise InvalidInputError(f"cannot read rows from '{file}': {error}") from error
        yield from ((f"'{file}', line {number}", line) for number, line in enumerate(text.splitlines(), 1))


def _object(where: str, text: str) -> Row:
    try:
        row = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise InvalidInputError(f"{where}: expected a JSON object, got {text[:60]!r}") from error
    if not isinstance(row, dict):
        raise InvalidInputError(f"{where}: expected a JSON object, got {text[:60]!r}")
    return row


def _problem(edition: Edition, row: Row) -> str:
    """What is wrong with a row, in a sentence; "": nothing."""
    if missing := [name for name in Cell._fields if name not in row]:
        return f"expected a row with {', '.join(missing)}, got {json.dumps(row)[:120]}"
    discipline = {one.name: one for one in edition.disciplines}.get(str(row["benchmark"]))
    entrants = [] if discipline is None else [one.name for one in edition.entrants_of(discipline)]
    if discipline is None or row["arm"] not in entrants:
        return f"edition '{edition.name}' has no '{row['arm']}' in '{row['benchmark']}'"
    if not isinstance(row["scenario"], str) or not isinstance(row["seed"], int | None):
        return f"expected a scenario's name and a seed, got {row['scenario']!r} and {row['seed']!r}"
    if row["training_seed"] is not None:
        return f"expected no seed of a training, got {row['training_seed']!r}"
    return "" if is_lost(row) else _problem_of_measures(discipline, row)


def _problem_of_measures(discipline: Discipline, row: Row) -> str:
    if not isinstance(row.get("record_hash"), str):
        return f"expected the hash of a record, got {row.get('record_hash')!r}"
    for name in (discipline.headline, *discipline.then):
        if name not in row or not (row[name] is None or _is_number(row[name])):
            return f"expected a number as {name}, got {row.get(name)!r}"
    if row.get("decision_ms") is not None and not _is_number(row["decision_ms"]):
        return f"expected a number as decision_ms, got {row['decision_ms']!r}"
    if discipline.family is not Family.DRIVING:
        return ""
    if not _is_number(row.get("driven_m")) or row["driven_m"] < 0:
        return f"expected metres as driven_m, got {row.get('driven_m')!r}"
    counts = row.get("infractions")
    if not isinstance(counts, dict) or not _are_counts(counts.items()):
        return f"expected infractions by kind, got {counts!r}"
    return ""


def _are_counts(pairs: Iterable[tuple[str, Any]]) -> bool:
    kinds = {kind.value for kind in InfractionKind}
    return all(kind in kinds and type(count) is int and count > 0 for kind, count in pairs)


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value)


def _told(cell: Cell) -> str:
    return f"{cell.arm} in {cell.benchmark}, {cell.scenario} s{cell.seed},"
