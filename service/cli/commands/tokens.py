"""`dohyo tokens`: access tokens, managed on the machine of the service."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Annotated

import typer
from sqlalchemy.orm import Session

from dohyo.service.accounts.model import Role
from dohyo.service.accounts.queries import create_token, list_tokens, revoke_token
from dohyo.service.accounts.views import view_token
from dohyo.service.cli.commands.serve import make_settings
from dohyo.service.cli.output import DASH, Json, console, print_json, print_rows
from dohyo.service.database.engine import Database, usable
from dohyo.service.database.identity import check_identity, check_served
from dohyo.service.database.server_lock import server_lock
from dohyo.sumo_networks.errors import InvalidInputError

Data = Annotated[Path | None, typer.Option(help="Folder of the service's data.")]
Url = Annotated[str | None, typer.Option("--database", help="URL of the service's database.")]


def create(
    owner: Annotated[str, typer.Option(help="Owner of the token; other owners cannot change what it submits.")],
    role: Annotated[Role, typer.Option(help="Permissions of the token.")] = Role.SUBMITTER,
    days: Annotated[
        float | None, typer.Option(min=0.001, max=36_500, help="Days until it expires; default: never.")
    ] = None,
    data: Data = None,
    database: Url = None,
    json: Json = False,
) -> None:
    """Creates a token and prints it. It cannot be shown again."""
    if not owner.isprintable() or not 0 < len(owner.strip()) <= 100:
        raise InvalidInputError(f"owner: expected 1 to 100 printable characters, got {owner!r}")
    with _session(data, database) as session:
        token, secret = create_token(session, owner, role, timedelta(days=days) if days is not None else None)
    if json:
        print_json(view_token(token).model_dump(mode="json") | {"token": secret})
    else:
        console.print(secret, highlight=False)


def show_all(data: Data = None, database: Url = None, json: Json = False) -> None:
    """Lists tokens, without their secrets."""
    with _session(data, database) as session:
        views = [view_token(token) for token in list_tokens(session)]
    if json:
        print_json([view.model_dump(mode="json") for view in views])
        return
    rows = [
        (
            *(view.id, view.owner, view.role.value, f"{view.created:%Y-%m-%d}"),
            *(f"{moment:%Y-%m-%d %H:%M}" if moment else DASH for moment in (view.expires, view.revoked)),
        )
        for view in views
    ]
    print_rows(("id", "owner", "role", "created", "expires", "revoked"), rows)


def revoke(
    identifier: Annotated[str, typer.Argument(help="Identifier, from `dohyo tokens list`.")],
    data: Data = None,
    database: Url = None,
) -> None:
    """Revokes a token at once and permanently."""
    with _session(data, database) as session:
        if revoke_token(session, identifier) is None:
            raise InvalidInputError(f"expected the identifier of a token (dohyo tokens list), got '{identifier}'")


@contextmanager
def _session(data: Path | None, url: str | None) -> Iterator[Session]:
    settings = make_settings({"data": data}, url)
    database = Database(settings.database_url)
    try:
        if settings.database is None or "data" in settings.model_fields_set:
            with usable():
                check_identity(settings.data, database)
        if settings.database is None:
            check_served(settings.data)
        if not database.is_migrated():
            with server_lock(database):  # migrates: a server of the earlier version would go on with other tables
                pass
        with database.session() as session:
            yield session
    finally:
        database.close()
