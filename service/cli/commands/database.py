"""`dohyo database`: the database of a service, managed on its machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dohyo.service.cli.commands.serve import make_settings
from dohyo.service.cli.output import Json, console, print_json
from dohyo.service.database.engine import Database


def move(
    to: Annotated[str, typer.Option(help="URL of an empty PostgreSQL or SQLite database.")],
    data: Annotated[Path | None, typer.Option(help="Folder of the service's data.")] = None,
    database: Annotated[str | None, typer.Option(help="URL of the present database; default: SQLite there.")] = None,
    json: Json = False,
) -> None:
    """Moves a stopped service into another database: all rows are copied, and the data folder belongs to it then.

    Serve it with that database from then on. The present one keeps its rows, and the folder refuses it.
    """
    from dohyo.service.database.moving import move as moved  # imports take a second

    settings = make_settings({"data": data}, database)
    source, target = Database(settings.database_url), Database(to)
    try:
        rows = moved(settings.data, source, target)
    finally:
        source.close()
        target.close()
    if json:
        print_json({"rows": rows})
    else:
        console.print(
            f"moved {sum(rows.values()):,} rows of {len(rows)} tables; serve '{settings.data}' with --database or"
            " DOHYO_DATABASE and the new URL",
            highlight=False,
        )
