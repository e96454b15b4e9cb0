"""Benchmarks of all families from their files: one place for what can be wrong with a name or a file."""

from __future__ import annotations

from typing import TypeVar

from pydantic import BaseModel, ValidationError

from dohyo.evaluation.benchmarks.documents import benchmark_path, family_of, keys_of_its_cell, read_document
from dohyo.evaluation.families import Family
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.faults import describe_fault

Model = TypeVar("Model", bound=BaseModel)


def load(name: str, family: Family, model: type[Model]) -> Model:
    """Loads a benchmark by its name, or from the path of a .toml file.

    Args:
        name: Name or path.
        family: Family that it must be of.
        model: Class of its benchmarks.

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
        return model.model_validate(document)
    except ValidationError as error:
        more = keys_of_its_cell(document) if family is Family.DRIVING else ()
        raise InvalidInputError(f"benchmark file '{path}': {describe_fault(error, model, document, more)}") from error
