"""Studies by name: each package SYSTEM/study lists its own in `STUDIES`, so that this floor names no system."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from dohyo.agents.studies.study import Study
from dohyo.evaluation.entry import load_entry
from dohyo.sumo_networks.errors import UnknownNameError


@cache
def studies() -> Mapping[str, str]:
    """Entries "module:STUDY" by name; their modules are not imported, since systems take seconds."""
    agents, found = __name__.rsplit(".", 2)[0], dict[str, str]()
    for room in sorted(Path(__file__).parents[1].glob("*/study/__init__.py")):
        package = f"{agents}.{room.parts[-3]}.study"
        listed: Mapping[str, str] = getattr(import_module(package), "STUDIES", {})
        found |= {name: f"{package}.{module}:STUDY" for name, module in listed.items()}
    return dict(sorted(found.items()))


def study_named(name: str) -> Study[Any]:
    """The study of a name.

    Raises:
        UnknownNameError: There is no such study.
    """
    if name not in studies():
        raise UnknownNameError("study", name, studies())
    study = load_entry(studies()[name], "study")
    assert isinstance(study, Study)
    return study
