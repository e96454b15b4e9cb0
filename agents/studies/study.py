"""Study: what a system compares; its cells, the work on them, and the tables and figures made of stored rows."""

from __future__ import annotations

import json
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.files.surroundings import surroundings
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.claims import Claim, Judgement, judge_rows
from dohyo.agents.studies.rows import Row, is_lost, read_rows
from dohyo.agents.studies.runner import Job, Progress, Trainings, run
from dohyo.agents.studies.tables import PAGE
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

O = TypeVar("O", bound=Config)  # noqa: E741
ROWS, FACTS = "rows.jsonl", "facts.json"
FIRST: Final = "0.1.0"
"""Version that made rows whose sessions were not noted."""


@dataclass(frozen=True, slots=True)
class Results:
    """Stored results of a study.

    Attributes:
        rows: A row per cell.
        facts: What holds for all rows: options, commits and commands of the sessions, sizes of the data, times.
    """

    rows: Sequence[Row]
    facts: Mapping[str, Any]

    @property
    def kept(self) -> list[Row]:
        """Rows of the cells that were not lost."""
        return [row for row in self.rows if not is_lost(row)]

    @property
    def versions(self) -> list[str]:
        """Versions of dohyo that made the rows that were not lost; empty without any."""
        noted = {one["versions"]["dohyo"] for one in self.facts.get("sessions", ())}
        return sorted(noted or {FIRST}) if self.kept else []


@dataclass(frozen=True, slots=True)
class Study(Generic[O]):
    """A study.

    Attributes:
        summary: Subject, in a few words.
        room: Folder of the system, with its RESULTS.md.
        options: Settings that change the rows, such as a folder of trainings.
        cells: All cells.
        work: Measures of the cells of one job; at the top of a module, since processes import it.
        tables: Sections of the page, each from the stored results; "" where the rows of a section are missing.
        together: Key of the job of a cell.
        trainings: Names of the trainings that the job of a cell begins, unless they are done; needed where several jobs
            have one, since two processes cannot train in the same folder.
        prepare: Makes what all cells need; called once before the first cell, with the cells and the number of workers.
        fresh: Whether each job gets a process of its own.
        phase: Phase of a cell; a phase begins when the one before has ended.
        read: Reads the results of a folder.
        facts: Facts of a run beside its options; called at its end. Until then those of earlier runs hold.
        figures: Draws the figures into a folder, and returns their paths; None without figures.
        judged: Judges the claims on the stored results; those whose arms have no rows are left out.
        published: Folder of the published rows in `results` of the room; "": that itself.
    """

    summary: str
    room: Path
    options: type[O]
    cells: Callable[[O], Sequence[Cell]]
    work: Callable[[O, Job], Iterable[Row]]
    tables: Mapping[str, Callable[[Results], str]]
    together: Callable[[Cell], Hashable] = lambda cell: cell
    trainings: Trainings = lambda cell: ()
    prepare: Callable[[O, Sequence[Cell], int], None] = lambda options, cells, workers: None
    fresh: bool = False
    phase: Callable[[Cell], int] = lambda cell: 0
    read: Callable[[Path], Results] = lambda folder: read_results(folder)
    facts: Callable[[O], Mapping[str, Any]] = lambda options: {}
    figures: Callable[[Results, Path], Sequence[Path]] | None = field(default=None)
    judged: Callable[[Results], Sequence[Judgement]] = lambda results: ()
    published: str = ""

    @property
    def stored(self) -> Path:
        """Folder of the published rows."""
        return self.room / "results" / self.published

    @property
    def page(self) -> Path:
        """RESULTS.md of the system."""
        return self.room / PAGE

    def run(
        self,
        out: Path,
        settings: Sequence[str] = (),
        *,
        chosen: Callable[[Cell], bool] = lambda cell: True,
        workers: int = 1,
        progress: Progress = lambda done, total, job: None,
    ) -> None:
        """Runs the missing cells into a folder; see `runner.run`.

        Args:
            out: Folder of the rows and facts.
            settings: Options as "key=value".
            chosen: Which cells are wanted.
            workers: Number of processes.
            progress: See `runner.run`.

        Raises:
            InvalidInputError: An option is wrong, no cell is wanted, or the folder has rows of other options or another
                version.
        """
        options = read_settings(self.options, None, settings)
        cells = [cell for cell in self.cells(options) if chosen(cell)]
        if not cells:
            raise InvalidInputError("expected arms, trainings and benchmarks of the study, got a choice without cells")
        given, earlier = options.model_dump(mode="json"), read_results(out)
        before = _defaults(self.options) | earlier.facts.get("options", given)  # older rows had an option's default
        if earlier.rows and before != given:
            raise InvalidInputError(f"'{out}' has rows of other options: expected {before}; choose another --out")
        if others := {*earlier.versions} - {here := version("dohyo")}:
            raise InvalidInputError(
                f"'{out}' has rows of dohyo {', '.join(sorted(others))}: expected {here}; choose another --out"
            )
        self.prepare(options, cells, workers)
        facts = earlier.facts if earlier.kept else {}  # those of sessions that made no row tell nothing
        facts = {**facts, "options": given, "sessions": [*facts.get("sessions", ()), surroundings()]}
        out.mkdir(parents=True, exist_ok=True)
        _write_facts(out, facts)
        work = partial(self.work, options)
        for _, some in groupby(sorted(cells, key=self.phase), self.phase):
            run(
                out / ROWS,
                some,
                work,
                workers=workers,
                together=self.together,
                trainings=self.trainings,
                fresh=self.fresh,
                progress=progress,
            )
        _write_facts(out, {**facts, **self.facts(options)})


def _defaults(options: type[Config]) -> Mapping[str, Any]:
    """Options that have a default, with it, as facts have them."""
    return options.model_construct().model_dump(mode="json")


def judging(claims: Sequence[Claim], **how: Any) -> Callable[[Results], list[Judgement]]:
    """Judges claims by stored rows, see `judge_rows`."""
    return lambda results: judge_rows(claims, results.rows, **how)


def read_results(folder: Path) -> Results:
    """Rows and facts of a folder; both are empty before the first row.

    Raises:
        InvalidInputError: A row has no cell.
    """
    facts = folder / FACTS
    return Results(read_rows(folder), json.loads(facts.read_text()) if facts.exists() else {})


def _write_facts(out: Path, facts: Mapping[str, Any]) -> None:
    write_atomically(out / FACTS, (json.dumps(facts, indent=1) + "\n").encode())
