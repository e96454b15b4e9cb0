"""`dohyo serve`: runs the service."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import SecretStr, ValidationError

from dohyo.service.settings import Settings
from dohyo.sumo_networks.errors import InvalidInputError

FAILED = 3


def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on; default: 127.0.0.1.")] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="0: a free one; default: 8000.")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder of records, policies and database.")] = None,
    database: Annotated[str | None, typer.Option(help="URL of a PostgreSQL or SQLite database.")] = None,
    executor: Annotated[str | None, typer.Option(help="Executor of the episodes: processes or ray.")] = None,
    ray_address: Annotated[str | None, typer.Option(help="Address of the Ray cluster; default: this machine.")] = None,
    processes: Annotated[int | None, typer.Option(min=1, help="Episodes driven at once; default: one per CPU.")] = None,
    insecure: Annotated[bool | None, typer.Option("--insecure", help="Listen beyond this machine without TLS.")] = None,
    league: Annotated[
        bool | None, typer.Option("--league", help="Show the league of dohyo's systems in the dashboard.")
    ] = None,
    tls_certificate: Annotated[Path | None, typer.Option(help="PEM file.")] = None,
    tls_key: Annotated[Path | None, typer.Option(help="PEM file.")] = None,
) -> None:
    """Runs the service until SIGTERM or Ctrl-C, then lets running episodes end.

    The first start prints an administrator's token, once. Settings come from DOHYO_... variables too.
    """
    given: dict[str, Any] = {"host": host, "port": port, "data": data, "insecure": insecure, "league": league}
    given |= {"executor": executor, "ray_address": ray_address, "processes": processes}
    given |= {"tls_certificate": tls_certificate, "tls_key": tls_key}
    from dohyo.service.server import run  # imports take a second, for which other commands must not wait

    if not run(make_settings(given, database), _announce):
        raise typer.Exit(FAILED)


def make_settings(given: dict[str, Any], database: str | None) -> Settings:
    """Settings from the environment, and from the options that were given.

    Raises:
        InvalidInputError: One of them is impossible.
    """
    options = {name: value for name, value in given.items() if value is not None}
    if database is not None:
        options["database"] = SecretStr(database)
    try:
        return Settings(**options)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InvalidInputError(f"setting '{where}': {first['msg']}") from error


def _announce(url: str, token: str | None) -> None:
    print(f"dohyo: {url}", flush=True)
    if token:
        print(f"dohyo: token of the administrator, shown only now: {token}", flush=True)
