"""`dohyo league run` and `verify`: drives the league, and rows of it again."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Annotated

import typer

from dohyo.agents.league import league
from dohyo.agents.league.edition import DOCUMENT, Discipline, Entrant, read_edition
from dohyo.agents.league.evaluating import Progress
from dohyo.agents.league.rows import check_version, read_league_rows
from dohyo.service.cli.commands.league_table import EditionFile, Rows
from dohyo.service.cli.output import console
from dohyo.service.cli.own_modules import find_own_modules
from dohyo.service.cli.progress import ProgressBar
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.processes import usable_processors

DIFFERS = 1


def run(
    disciplines: Annotated[str | None, typer.Option(help="Names, such as town,city; default: all.")] = None,
    entrants: Annotated[str | None, typer.Option(help="Names, such as ghrl,mbappe; default: all.")] = None,
    out: Annotated[Path, typer.Option(help="Folder of the evaluations.")] = Path("out/league"),
    rows: Annotated[Path | None, typer.Option(help="Folder of the rows; default: the same.")] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; default: one per CPU.")] = None,
    edition: EditionFile = DOCUMENT,
) -> None:
    """Drives every entrant in every discipline. Run again, it continues where it stopped."""
    find_own_modules()
    names = [text.split(",") if text else [] for text in (disciplines, entrants)]
    chosen = read_edition(edition)
    count = len(league.chosen_of(chosen, *names))
    done = 0

    def tell(discipline: Discipline, entrant: Entrant) -> AbstractContextManager[Progress]:
        nonlocal done
        done += 1
        console.print(f"{done} of {count}: {entrant.name} in {discipline.name}")
        return ProgressBar(f"{entrant.name} in {discipline.name}")

    league.run(chosen, out, *names, rows=rows, workers=workers or usable_processors(), tell=tell)
    console.print(f"rows: {rows or out}")


def verify(
    rows: Rows = None,
    sample: Annotated[int, typer.Option(min=1, help="Rows of each entrant in each discipline.")] = 2,
    seed: Annotated[int, typer.Option(help="Of the choice.")] = 0,
    disciplines: Annotated[str | None, typer.Option(help="Names, such as town,city; default: all.")] = None,
    entrants: Annotated[str | None, typer.Option(help="Names, such as ghrl,mbappe; default: all.")] = None,
    edition: EditionFile = DOCUMENT,
) -> None:
    """Drives rows of the league again. Exit code 1 if a record's hash or a measure differs."""
    find_own_modules()
    chosen, folder = read_edition(edition), rows or edition.parent
    names = [text.split(",") if text else [] for text in (disciplines, entrants)]
    wanted = {(discipline.name, entrant.name) for discipline, entrant in league.chosen_of(chosen, *names)}
    stored = [row for row in read_league_rows(chosen, folder) if (row["benchmark"], row["arm"]) in wanted]
    if not stored:
        raise InvalidInputError(f"'{folder}': expected rows of the league, found none")
    check_version(folder, stored)
    same = True
    for check in league.verify(chosen, stored, sample, seed):
        row, differences = check.row, check.differences
        told = f"differs: {', '.join(differences)}" if differences else "same"
        console.print(f"{row['arm']} in {row['benchmark']}, {row['scenario']} s{row['seed']}: {told}")
        same &= not differences
    if not same:
        raise typer.Exit(DIFFERS)
