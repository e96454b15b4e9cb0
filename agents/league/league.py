"""League: runs an edition into a folder, keeps its rows, and drives rows again to check their hashes."""

from __future__ import annotations

import json
import math
import random
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from dohyo.agents.league.edition import Discipline, Edition, Entrant
from dohyo.agents.league.evaluating import Progress, check_entrant, evaluate
from dohyo.agents.league.rows import check_version, read_league_rows
from dohyo.agents.learning.files.surroundings import surroundings
from dohyo.agents.studies.rows import Row, is_lost
from dohyo.agents.studies.study import FACTS, ROWS
from dohyo.evaluation.families import Family
from dohyo.evaluation.running.lock import held
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.files import write_atomically

Tell = Callable[[Discipline, Entrant], AbstractContextManager[Progress]]
"""Called before an evaluation; what it gives is called during it."""


def _untold(discipline: Discipline, entrant: Entrant) -> AbstractContextManager[Progress]:
    return nullcontext(lambda done, total: None)


def run(
    edition: Edition,
    out: Path,
    disciplines: Sequence[str] = (),
    entrants: Sequence[str] = (),
    *,
    rows: Path | None = None,
    workers: int = 1,
    tell: Tell = _untold,
) -> None:
    """Evaluates entrants; a second call drives only what is missing. Rows are written after each evaluation.

    Args:
        edition: What is driven.
        out: Folder of the evaluations, OUT/DISCIPLINE/ENTRANT each.
        disciplines: Names; empty: all.
        entrants: Names; empty: all.
        rows: Folder of the rows; None: `out`. Rows of other evaluations stay.
        workers: Number of processes.
        tell: Called before each evaluation.

    Raises:
        UnknownNameError: A name is not in the edition.
        InvalidInputError: An entrant cannot be made, or `rows` has rows of another edition or version of dohyo, or rows
            of a chosen evaluation in another file than its rows.jsonl.
        SimulationError: SUMO failed.
    """
    folder = rows or out
    chosen = chosen_of(edition, disciplines, entrants)
    for _, entrant in chosen:
        check_entrant(entrant)
    with held(folder, "league"):
        check_version(folder, read_league_rows(edition, folder))  # before hours of driving
        _check_files(folder, edition, chosen)
        for discipline, entrant in chosen:
            place, began = out / discipline.name / entrant.folder, surroundings()
            with tell(discipline, entrant) as progress:
                _replace(folder, edition, _evaluated(discipline, entrant, place, workers, progress), began)


def _check_files(folder: Path, edition: Edition, chosen: Sequence[tuple[Discipline, Entrant]]) -> None:
    """Refuses evaluations whose rows lie in another file of the folder, since `_replace` leaves that as it is."""
    for path in sorted(folder.glob("*.jsonl")):
        rows = [] if path.name == ROWS else read_league_rows(edition, path)
        there = {(row["benchmark"], row["arm"]) for row in rows}
        for discipline, entrant in chosen:
            if (discipline.name, entrant.name) in there:
                raise InvalidInputError(
                    f"'{path}' has rows of {entrant.name} in {discipline.name}: expected them in {ROWS}; "
                    "move them there, or choose other entrants or another folder"
                )


def _evaluated(discipline: Discipline, entrant: Entrant, out: Path, workers: int, progress: Progress) -> list[Row]:
    """Rows of an evaluation; an error names it."""
    try:
        return evaluate(discipline, entrant, out, workers, progress)
    except InvalidInputError as error:
        raise InvalidInputError(f"{entrant.name} in {discipline.name}: {error}") from error


def chosen_of(
    edition: Edition, disciplines: Sequence[str], entrants: Sequence[str]
) -> list[tuple[Discipline, Entrant]]:
    """Evaluations of some disciplines and entrants; empty: of all.

    Raises:
        UnknownNameError: A name is not in the edition.
        InvalidInputError: No entrant is for one of the disciplines.
    """
    named = {one.name for one in edition.entrants}
    if unknown := [name for name in entrants if name not in named]:
        raise UnknownNameError("entrant", unknown[0], named)
    wanted = [edition.discipline(name) for name in disciplines] or edition.disciplines
    found = [
        (discipline, entrant)
        for discipline in wanted
        for entrant in edition.entrants_of(discipline)
        if not entrants or entrant.name in entrants
    ]
    if not found:
        raise InvalidInputError(
            f"expected entrants for {', '.join(one.name for one in wanted)}, got {', '.join(entrants)}"
        )
    return found


def _replace(folder: Path, edition: Edition, rows: Sequence[Row], began: Mapping[str, Any]) -> None:
    """Writes the rows of one evaluation in the place of earlier ones, and where and when they were begun.

    The same rows again keep what is told of them. Other files of the folder stay as they are.
    """
    path, facts = folder / ROWS, folder / FACTS
    mine = (rows[0]["benchmark"], rows[0]["arm"])
    stored = read_league_rows(edition, path) if path.exists() else []
    kept = [row for row in stored if (row["benchmark"], row["arm"]) != mine]
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(path, "".join(json.dumps(row) + "\n" for row in (*kept, *rows)).encode())
    evaluations = json.loads(facts.read_text())["evaluations"] if facts.exists() else {}
    if len(kept) < len(stored) and [row for row in stored if row not in kept] == list(rows):
        began = evaluations.get("/".join(mine), began)
    told = {"edition": edition.name, "evaluations": {**evaluations, "/".join(mine): began}}
    write_atomically(facts, (json.dumps(told, indent=1) + "\n").encode())


NOT_COMPARED: Final = ("decision_ms",)
"""Fields of a row that depend on the machine."""


@dataclass(frozen=True, slots=True)
class Check:
    """One row that was driven again.

    Attributes:
        row: The row.
        again: The new row; empty: there is none.
    """

    row: Row
    again: Row

    @property
    def differences(self) -> list[str]:
        """Fields of the row that the new one does not have so: the hash of the record, and every measure."""
        return [
            name
            for name, value in self.row.items()
            if name not in NOT_COMPARED and not _equal(value, self.again.get(name))
        ]


def _equal(mine: Any, other: Any) -> bool:
    if isinstance(mine, float) and isinstance(other, int | float):
        return math.isclose(mine, other, rel_tol=1e-9, abs_tol=1e-9)  # last bits depend on the processor
    return bool(mine == other)


def verify(edition: Edition, rows: Iterable[Row], sample: int, seed: int) -> Iterable[Check]:
    """Drives some rows of each entrant in each discipline again, from nothing.

    Days and mornings have one record for all of them, so that they are all done again.

    Args:
        edition: Their edition.
        rows: Rows of the league.
        sample: Number of rows of each entrant in each discipline.
        seed: Seed of the choice.

    Raises:
        SimulationError: SUMO failed.
    """
    groups = dict[tuple[str, str], list[Row]]()
    for row in rows:
        if not is_lost(row):
            groups.setdefault((row["benchmark"], row["arm"]), []).append(row)
    generator = random.Random(seed)
    entrants = {one.name: one for one in edition.entrants}
    for (name, arm), found in groups.items():
        drawn = generator.sample(found, min(sample, len(found)))
        yield from _again(edition.discipline(name), entrants[arm], drawn)


def _again(discipline: Discipline, entrant: Entrant, drawn: Sequence[Row]) -> Iterator[Check]:
    if discipline.family in (Family.DRIVING, Family.PARKING):
        for row in drawn:
            (again,) = _driven_again(only(discipline, row), entrant)
            yield Check(row, again)
    else:
        by_unit = {one["scenario"]: one for one in _driven_again(discipline, entrant)}
        yield from (Check(row, by_unit.get(row["scenario"], {})) for row in drawn)


def _driven_again(discipline: Discipline, entrant: Entrant) -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        return evaluate(discipline, entrant, Path(folder) / "again")


def only(discipline: Discipline, row: Row) -> Discipline:
    """A discipline of the scenario of one row; of days and mornings, all."""
    if discipline.family is Family.DRIVING:
        seeds = (row["seed"],) if row["seed"] in discipline.seeds else discipline.seeds  # excerpts have their own
        few = {"only": (row["scenario"],), "even": False, "sample": None, "seeds": seeds}
        return discipline.model_copy(update=few)
    if discipline.family is Family.PARKING:
        return discipline.model_copy(update={"seeds": (row["seed"], 1)})
    return discipline
