"""Benchmarks of all families from their files: one place for what can be wrong with a name or a file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from pydantic import ValidationError

from dohyo.evaluation.benchmarks.documents import benchmark_path, family_of, read_document
from dohyo.evaluation.families import Family
from dohyo.sumo_networks.errors import InvalidInputError

Model = TypeVar("Model")


def load(name: str, family: Family, validate: Callable[[dict[str, Any]], Model]) -> Model:
    """Loads a benchmark by its name, or from the path of a .toml file.

    Args:
        name: Name or path.
        family: Family that it must be of.
        validate: Function from the document to the benchmark, which raises pydantic's ValidationError.

    Raises:
        UnknownNameError: The family has no benchmark of this name.
        InvalidInputError: The file is missing, invalid or of another family; the message says where.
    """
    path = benchmark_path(name, family)
    document = read_document(path)
    found = family_of(document, str(path))
    if found is not family:
        raise InvalidInputError(
            f"benchmark file '{path}': expected a benchmark of {family.label}, got one of {found.label}"
        )
    try:
        return validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        raise InvalidInputError(f"benchmark file '{path}': {where}: {first['msg']}") from error
