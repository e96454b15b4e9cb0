"""`dohyo league table`: makes the league's page without the drivers, whose libraries take as long to import."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dohyo.agents.league import figures, localization
from dohyo.agents.league.edition import DOCUMENT, read_edition
from dohyo.agents.league.page import page
from dohyo.agents.league.rows import read_comparable_rows, versions_of
from dohyo.evaluation.output_file import write_output
from dohyo.service.cli.output import console

EditionFile = Annotated[
    Path,
    typer.Option("--edition", help="TOML file of disciplines and entrants.", show_default="the published edition"),
]
Rows = Annotated[Path | None, typer.Option(help="Folder of the rows; default: that of the edition's file.")]


def table(
    rows: Rows = None,
    out: Annotated[Path | None, typer.Option(help="File; default: print the page.")] = None,
    edition: EditionFile = DOCUMENT,
) -> None:
    """Makes the league's page from stored rows."""
    more = f"{figures.SECTION}\n\n{localization.section()}" if edition == DOCUMENT else ""
    chosen, folder = read_edition(edition), rows or edition.parent
    stored = read_comparable_rows(chosen, folder)
    text = page(chosen, stored, more, sorted(versions_of(folder, stored)))
    if out is None:
        print(text)  # Markdown, for files and pipes
    else:
        write_output(out, text.encode())
        console.print(f"page: {out}")
