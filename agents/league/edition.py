"""Edition: the disciplines of the league, who enters them, and the seeds; fixed before the first drive."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from dohyo.agents.league.measures import measures_of
from dohyo.agents.league.weights import count_parameters
from dohyo.agents.learning.files.settings import read_settings
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.documents import find_family
from dohyo.evaluation.families import Family
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

PUBLISHED: Final = Path(__file__).parent / "editions" / "2027-01"
"""Folder of the edition that comes with dohyo, with its rows."""
DOCUMENT: Final = PUBLISHED / "edition.toml"
AGENTS: Final = Path(__file__).parents[1]

Label = Annotated[str, Field(pattern=r"^\w[\w. -]{0,99}$")]
"""A name in rows, of which a folder's name is made."""
Line = Annotated[str, Field(pattern=r"^[^\r\n|]+$")]
"""Text in one cell of a table."""
Seed = Annotated[int, Field(ge=0, lt=2**31)]


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

    name: Label
    title: Line
    told: str
    benchmark: str
    only: tuple[str, ...] = ()
    even: bool = False
    sample: Annotated[int, Field(ge=1)] | None = None
    seeds: tuple[Seed, ...] = ()
    headline: str
    then: tuple[str, ...] = ()

    @cached_property
    def family(self) -> Family:
        """Family of the benchmark."""
        return find_family(self.benchmark)

    @property
    def problem(self) -> str:
        """What contradicts the family of the benchmark, in a sentence; "": nothing.

        Raises:
            InvalidInputError: There is no such benchmark.
        """
        if unknown := [one for one in (self.headline, *self.then) if one not in self._measures()]:
            return f"expected measures of '{self.benchmark}' ({', '.join(self._measures())}), got '{unknown[0]}'"
        if self.family is not Family.DRIVING and (self.only or self.even or self.sample is not None):
            return f"expected 'only', 'even' and 'sample' of driving alone, got them for '{self.benchmark}'"
        if self.family is Family.FORECASTING and self.seeds:
            return f"expected no seeds, since the days of '{self.benchmark}' are fixed, got {list(self.seeds)}"
        if self.family is Family.PARKING:
            good = len(self.seeds) == 2 and self.seeds[1] > 0
            return "" if good else f"expected seeds = [the first seed, the number of lots], got {list(self.seeds)}"
        if self.family is not Family.FORECASTING and (not self.seeds or len({*self.seeds}) < len(self.seeds)):
            return f"expected at least one seed, and each once, got {list(self.seeds)}"
        return ""

    def _measures(self) -> list[str]:
        """Measures of the rows."""
        scored = self.family is Family.DRIVING and load_benchmark(self.benchmark).closed_loop
        return [one for one in measures_of(self.family) if scored or one != "closed_loop"]


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

    name: Label
    agent: str = ""
    settings: Mapping[str, Any] = Field(default_factory=dict)
    family: Family
    system: Line
    thesis: Line | Literal[""] = ""
    weights: tuple[str, ...] = ()
    reported: Mapping[str, Line] = Field(default_factory=dict)

    @property
    def registered(self) -> str:
        """Name of the agent in the registry."""
        return self.agent or self.name

    @property
    def parameters(self) -> int:
        """Number of learned parameters in its weights.

        Raises:
            InvalidInputError: Weights are missing, or no weights.
        """
        return sum(count_parameters(AGENTS / one) for one in self.weights)

    @property
    def folder(self) -> str:
        """Its folder's name, without blanks."""
        return self.name.replace(" ", "-")


class Edition(Config):
    """The league.

    Attributes:
        name: Year and month.
        told: What it is, for readers of the page.
        looked_at: Which of its seeds had been looked at before they were driven, or led to changes, a paragraph each;
            empty: none.
        disciplines: By their order on the page.
        entrants: By their order on the page.
    """

    name: Line
    told: str = ""
    looked_at: tuple[Line, ...] = ()
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
    edition = read_settings(Edition, path)
    if problem := _problem(edition):
        raise InvalidInputError(f"'{path}': {problem}")
    return edition


def _problem(edition: Edition) -> str:
    """What contradicts itself in an edition, in a sentence; "": nothing."""
    disciplines = [one.name for one in edition.disciplines]
    for what, names in (("discipline", disciplines), ("entrant", [one.folder for one in edition.entrants])):
        if not names:
            return f"expected at least one {what}, found none"
        if repeated := [name for name, count in Counter(names).items() if count > 1]:
            return f"expected different names of {what}s, got '{repeated[0]}' twice"
    for discipline in edition.disciplines:
        if discipline.problem:
            return f"discipline '{discipline.name}': {discipline.problem}"
    for entrant in edition.entrants:
        if unknown := [name for name in entrant.reported if name not in disciplines]:
            return f"entrant '{entrant.name}': expected reported numbers of a discipline, got one of '{unknown[0]}'"
    return ""
