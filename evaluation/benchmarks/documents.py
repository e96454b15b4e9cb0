"""The TOML files of benchmarks as plain tables: enough for a list, without the models of all scripted events."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

BENCHMARKS = Path(__file__).parent
FREEWAY_BENCHMARKS = BENCHMARKS / "freeway"
PARKING_BENCHMARKS = BENCHMARKS / "parking"
_OF_A_CELL = ("network", "traffic", "conditions", "events")


def benchmark_names() -> list[str]:
    """Sorted names of the built-in benchmarks."""
    return sorted(path.stem for path in BENCHMARKS.glob("*.toml"))


def freeway_benchmark_names() -> list[str]:
    """Sorted names of the built-in benchmarks of the freeway."""
    return sorted(path.stem for path in FREEWAY_BENCHMARKS.glob("*.toml"))


def parking_benchmark_names() -> list[str]:
    """Sorted names of the built-in benchmarks of parking."""
    return sorted(path.stem for path in PARKING_BENCHMARKS.glob("*.toml"))


def benchmark_path(name: str) -> Path:
    """File of a built-in benchmark."""
    return BENCHMARKS / f"{name}.toml"


def freeway_benchmark_path(name: str) -> Path:
    """File of a built-in benchmark of the freeway."""
    return FREEWAY_BENCHMARKS / f"{name}.toml"


def parking_benchmark_path(name: str) -> Path:
    """File of a built-in benchmark of parking."""
    return PARKING_BENCHMARKS / f"{name}.toml"


def read_document(path: Path) -> dict[str, Any]:
    """The tables of a file; a file that is `like` another one takes missing keys from that one.

    Raises:
        OSError: The file cannot be read.
        ValueError: It is not valid TOML.
    """
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    if (like := document.pop("like", None)) is None:
        return document
    return read_document(path.with_name(f"{like}.toml")) | document


def with_cells(document: dict[str, Any]) -> dict[str, Any]:
    """The long form of a document: one without cells has a single cell "all"."""
    if "cells" in document or not isinstance(document.get("missions"), list | tuple):
        return document
    parts = {key: document[key] for key in _OF_A_CELL if key in document}
    rest = {key: value for key, value in document.items() if key not in parts}
    return rest | {"cells": [{"name": "all", "missions": "all", **parts}], "missions": {"all": document["missions"]}}


def count_scenarios(document: dict[str, Any]) -> int:
    """Number of scenarios of a valid document for one seed; see `Benchmark.size`."""
    long = with_cells(document)
    each = long.get("every_condition", False)
    return sum(
        (1 if cell.get("together") else len(long["missions"][cell["missions"]]))
        * (len(cell.get("conditions", ("clear",))) if each else 1)
        for cell in long["cells"]
    )
