"""League: runs an edition into a folder, keeps its rows, and drives rows again to check their hashes."""

from __future__ import annotations

import json
import random
import tempfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from dohyo.agents.league.edition import Discipline, Edition, Entrant
from dohyo.agents.league.evaluating import Progress, evaluate
from dohyo.agents.learning.runs.run import surroundings
from dohyo.agents.studies.rows import Row, is_lost, read_rows
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
        SimulationError: SUMO failed.
    """
    folder = rows or out
    chosen = chosen_of(edition, disciplines, entrants)
    with held(folder, "league"):
        for discipline, entrant in chosen:
            # Blanks are no part of folders' names.
            place = out / discipline.name / entrant.name.replace(" ", "-")
            with tell(discipline, entrant) as progress:
                _replace(folder, edition, evaluate(discipline, entrant, place, workers, progress))


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


def _replace(folder: Path, edition: Edition, rows: Sequence[Row]) -> None:
    """Writes the rows of one evaluation in the place of earlier ones, and the command that made them."""
    path, facts = folder / ROWS, folder / FACTS
    mine = (rows[0]["benchmark"], rows[0]["arm"])
    kept = [row for row in (read_rows(path) if path.exists() else ()) if (row["benchmark"], row["arm"]) != mine]
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(path, "".join(json.dumps(row) + "\n" for row in (*kept, *rows)).encode())
    evaluations = json.loads(facts.read_text())["evaluations"] if facts.exists() else {}
    told = {"edition": edition.name, "evaluations": {**evaluations, "/".join(mine): surroundings()}}
    write_atomically(facts, (json.dumps(told, indent=1) + "\n").encode())


@dataclass(frozen=True, slots=True)
class Check:
    """One row that was driven again.

    Attributes:
        row: The row.
        record_hash: Hash of the new record.
    """

    row: Row
    record_hash: str

    @property
    def same(self) -> bool:
        """Whether both hashes are equal."""
        return bool(self.record_hash == self.row["record_hash"])


def verify(edition: Edition, rows: Iterable[Row], sample: int, seed: int) -> Iterable[Check]:
    """Drives some rows of each entrant in each discipline again, from nothing.

    Days and mornings have one hash for all of them, so that they are all done again.

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


def _again(discipline: Discipline, entrant: Entrant, drawn: Sequence[Row]) -> Iterable[Check]:
    for row in drawn if discipline.family in (Family.DRIVING, Family.PARKING) else drawn[:1]:
        with tempfile.TemporaryDirectory() as folder:
            again = evaluate(only(discipline, row), entrant, Path(folder) / "again")
        yield Check(row, again[0]["record_hash"])


def only(discipline: Discipline, row: Row) -> Discipline:
    """A discipline of the scenario of one row; of days and mornings, all."""
    if discipline.family is Family.DRIVING:
        seeds = (row["seed"],) if row["seed"] in discipline.seeds else discipline.seeds  # excerpts have their own
        few = {"only": (row["scenario"],), "even": False, "sample": None, "seeds": seeds}
        return discipline.model_copy(update=few)
    if discipline.family is Family.PARKING:
        return discipline.model_copy(update={"seeds": (row["seed"], 1)})
    return discipline
