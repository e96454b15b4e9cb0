"""The TOML files of benchmarks as plain tables: enough for a list, without the models of all scripted events."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from dohyo.evaluation.families import Family
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

BENCHMARKS = Path(__file__).parent
_OF_A_CELL = ("network", "traffic", "conditions", "events")


_FOLDERS = {
    Family.DRIVING: ".",
    Family.FREEWAY: "freeway",
    Family.PARKING: "parking",
    Family.FORECASTING: "forecasting",
}
_FAMILIES = {"forecast": Family.FORECASTING, "traffic": Family.FREEWAY, "parking": Family.PARKING}
"""Family by the key `kind` of a file; files without it are of driving."""


def benchmark_names(family: Family) -> list[str]:
    """Sorted names of the built-in benchmarks of a family."""
    return sorted(path.stem for path in (BENCHMARKS / _FOLDERS[family]).glob("*.toml"))


def benchmark_path(name: str, family: Family) -> Path:
    """File of a benchmark: a path that ends with .toml, or that of a built-in one.

    Raises:
        UnknownNameError: The family has no benchmark of this name.
        InvalidInputError: It is no text.
    """
    if not isinstance(name, str):
        raise InvalidInputError(f"expected the name of a benchmark, or the path of its file as text, got {name!r}")
    if name.endswith(".toml"):
        return Path(name)
    if name not in benchmark_names(family):
        raise UnknownNameError(f"benchmark of {family.label}", name, benchmark_names(family))
    return BENCHMARKS / _FOLDERS[family] / f"{name}.toml"


def find_family(name: str) -> Family:
    """Family of a benchmark, by its name or by the kind in a .toml file.

    Raises:
        UnknownNameError: No family has a benchmark of this name.
        InvalidInputError: The file cannot be read, or its kind is unknown.
    """
    if name.endswith(".toml"):
        return family_of(read_document(Path(name)), name)
    families = {known: family for family in Family for known in benchmark_names(family)}
    if name not in families:
        raise UnknownNameError("benchmark", name, families)
    return families[name]


def family_of(document: dict[str, Any], where: str) -> Family:
    """Family of a document; `where` names its file in the error.

    Raises:
        InvalidInputError: The kind is unknown.
    """
    if "kind" not in document:
        return Family.DRIVING
    kind = document["kind"]
    if not isinstance(kind, str) or kind not in _FAMILIES:
        kinds = ", ".join(f"'{known}'" for known in _FAMILIES)
        raise InvalidInputError(
            f"benchmark file '{where}': kind: expected {kinds}, or no kind for a benchmark of driving, got {kind!r}"
        )
    return _FAMILIES[kind]


def read_document(path: Path) -> dict[str, Any]:
    """The tables of a file; a file that is `like` another one takes missing keys from that one.

    Raises:
        InvalidInputError: A file cannot be read, is not valid TOML, or is like itself.
    """
    files = [path]
    document = _tables(path)
    while (like := document.pop("like", None)) is not None:
        files.append(path.with_name(f"{like}.toml"))
        if files[-1] in files[:-1]:
            raise InvalidInputError(f"benchmark file '{path}': like: expected another file, got '{like}' again")
        document = _tables(files[-1]) | document
    return document


def _tables(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidInputError(f"cannot read benchmark file '{path}': {error.strerror}") from error
    except ValueError as error:
        raise InvalidInputError(f"benchmark file '{path}' is not valid TOML: {error}") from error


def with_cells(document: dict[str, Any]) -> dict[str, Any]:
    """The long form of a document: one without cells has a single cell "all"."""
    if "cells" in document or not isinstance(document.get("missions"), list | tuple):
        return document
    parts = {key: document[key] for key in _OF_A_CELL if key in document}
    rest = {key: value for key, value in document.items() if key not in parts}
    return rest | {"cells": [{"name": "all", "missions": "all", **parts}], "missions": {"all": document["missions"]}}


def keys_of_its_cell(document: dict[str, Any]) -> tuple[str, ...]:
    """Keys of a cell that a document may have itself, which is without cells."""
    return () if "cells" in document else _OF_A_CELL


def count_scenarios(document: dict[str, Any]) -> int:
    """Number of scenarios of a valid document for one seed; see `Benchmark.size`."""
    long = with_cells(document)
    each = long.get("every_condition", False)
    return sum(
        (1 if cell.get("together") else len(long["missions"][cell["missions"]]))
        * (len(cell.get("conditions", ("clear",))) if each else 1)
        for cell in long["cells"]
    )
