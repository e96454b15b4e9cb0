"""Edition: the disciplines of the league, who enters them, and the seeds; fixed before the first drive."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final

import onnx
from pydantic import Field

from dohyo.agents.learning.files.settings import read_settings
from dohyo.evaluation.benchmarks.documents import find_family
from dohyo.evaluation.families import Family
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import UnknownNameError

PUBLISHED: Final = Path(__file__).parent / "editions" / "2026-11"
"""Folder of the edition that comes with dohyo, with its rows."""
DOCUMENT: Final = PUBLISHED / "edition.toml"
AGENTS: Final = Path(__file__).parents[1]


class Discipline(Config):
    """A part of a benchmark, on seeds of its own.

    Attributes:
        name: Name in rows.
        title: Name for people.
        told: What it consists of, in one or two sentences.
        benchmark: Name of the benchmark.
        only: Cells and missions, as for `dohyo evaluate --only`; empty: all.
        even: Whether only even-numbered missions are driven.
        sample: Number of missions that are drawn from those; None: all.
        seeds: Seeds of the drives, or of the mornings; of lots the first seed and their number; empty: fixed days.
        headline: Measure that ranks.
        then: Measures beside it.
    """

    name: str
    title: str
    told: str
    benchmark: str
    only: tuple[str, ...] = ()
    even: bool = False
    sample: int | None = None
    seeds: tuple[int, ...] = ()
    headline: str
    then: tuple[str, ...] = ()

    @property
    def family(self) -> Family:
        """Family of the benchmark."""
        return find_family(self.benchmark)


class Entrant(Config):
    """An agent in all disciplines of its family.

    Attributes:
        name: Name in rows.
        agent: Registered name of the agent; "": the same.
        settings: Settings of the agent.
        family: Family of its disciplines.
        system: What it is, in a few words.
        thesis: Thesis whose system it is; "": none.
        weights: Files and folders of its weights, relative to `agents/`; empty: nothing is learned.
        reported: The source's own numbers, by discipline, with what they were measured on.
    """

    name: str
    agent: str = ""
    settings: Mapping[str, Any] = Field(default_factory=dict)
    family: Family
    system: str
    thesis: str = ""
    weights: tuple[str, ...] = ()
    reported: Mapping[str, str] = Field(default_factory=dict)

    @property
    def registered(self) -> str:
        """Name of the agent in the registry."""
        return self.agent or self.name

    @property
    def parameters(self) -> int:
        """Number of learned numbers in its weights."""
        files = [file for one in self.weights for file in _weight_files(AGENTS / one)]
        return sum(map(_parameters, files))


class Edition(Config):
    """The league.

    Attributes:
        name: Year and month.
        told: What it is, for readers of the page.
        looked_at: Which of its seeds had been looked at before they were driven, or led to changes; "": none.
        disciplines: By their order on the page.
        entrants: By their order on the page.
    """

    name: str
    told: str = ""
    looked_at: str = ""
    disciplines: tuple[Discipline, ...] = Field(alias="discipline")
    entrants: tuple[Entrant, ...] = Field(alias="entrant")

    def discipline(self, name: str) -> Discipline:
        """Discipline of a name.

        Raises:
            UnknownNameError: There is none.
        """
        by_name = {one.name: one for one in self.disciplines}
        if name not in by_name:
            raise UnknownNameError("discipline", name, by_name)
        return by_name[name]

    def entrants_of(self, discipline: Discipline) -> list[Entrant]:
        """Who enters a discipline."""
        return [one for one in self.entrants if one.family is discipline.family]


@cache
def read_edition(path: Path = DOCUMENT) -> Edition:
    """The edition in a file.

    Raises:
        InvalidInputError: The file is missing or no edition; the message says why.
    """
    return read_settings(Edition, path)


def _weight_files(path: Path) -> list[Path]:
    """A file, or of a folder its safetensors, or its ONNX files where it has none: they hold the same numbers twice."""
    if path.is_file():
        return [path]
    return sorted(path.rglob("*.safetensors")) or sorted(path.rglob("*.onnx"))


@cache
def _parameters(path: Path) -> int:
    if path.suffix == ".onnx":
        return sum(math.prod(one.dims) for one in onnx.load(str(path)).graph.initializer)
    content = path.read_bytes()
    header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    return sum(math.prod(one["shape"]) for name, one in header.items() if name != "__metadata__")
