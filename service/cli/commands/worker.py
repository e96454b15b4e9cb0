"""`dohyo worker`: drives an agent's episodes for a service, from this machine."""

from __future__ import annotations

import logging
import os
from pathlib import Path
from typing import Annotated

import typer

from dohyo.agents.registry import describe_agent, resolve_with
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.cli.commands.evaluate import parse_settings
from dohyo.service.cli.own_modules import find_own_modules
from dohyo.service.client.client import Client
from dohyo.service.client.errors import ServiceError
from dohyo.service.client.worker import TALLY, Driver, keep_working, shares, work
from dohyo.service.client.worker_session import WorkerSession

TOKEN = "DOHYO_TOKEN"

logger = logging.getLogger("dohyo.worker")


def worker(
    server: Annotated[
        str, typer.Option(envvar="DOHYO_SERVER", help="Address of the service, such as http://127.0.0.1:8000.")
    ],
    agent: Annotated[str, typer.Option(help="Its name at the service.")],
    token: Annotated[str, typer.Option(envvar=TOKEN, help="Token of role worker; of role submitter, to submit too.")],
    entry: Annotated[str | None, typer.Option(help="Registered name or module:Class here; default: --agent.")] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value for the agent; repeatable.")] = None,
    capacity: Annotated[int, typer.Option(min=1, max=64, help="Episodes at once, one process each.")] = 1,
    episodes: Annotated[
        int | None, typer.Option(min=1, help="Episodes to drive, all processes together; default: no end.")
    ] = None,
) -> None:
    """Drives an agent's episodes for a service until stopped. Submits the agent first if needed."""
    logging.basicConfig(format="dohyo worker: %(message)s", level=logging.INFO)
    logging.getLogger("httpx").setLevel(logging.WARNING)
    find_own_modules()
    resolved, given = resolve_with(entry or agent, parse_settings(settings or []))
    info = describe_agent(resolved, given, "remote")
    version = _declare(server, token, agent, info)
    logger.info("agent '%s', version %d, for %s", agent, version, server)
    driven = shares(episodes, capacity)
    if len(driven) == 1:
        tally = os.environ.get(TALLY)
        session = WorkerSession(server, token, agent, version=version)
        work(session, Driver(resolved, given), episodes, Path(tally) if tally else None)
        return
    command = ["-c", "from dohyo.service.cli import main; main()", "worker", "--server", server, "--agent", agent]
    command += ["--entry", entry or agent, *[part for pair in settings or [] for part in ("--set", pair)]]
    keep_working(command, driven, {TOKEN: token})  # arguments are readable by all users of this machine


def _declare(server: str, token: str, agent: str, info: AgentInfo) -> int:
    """Version of an agent at the service.

    Raises:
        ServiceError: The service refuses for good.
        typer.Exit: It cannot answer now; unlike bad input, this lets `keep_working` start the process again.
    """
    try:
        with Client(server, token) as client:
            return client.ensure_remote(agent, info)
    except ServiceError as error:
        if not error.passes:
            raise
        logger.error("%s", error)
        raise typer.Exit(os.EX_TEMPFAIL) from error
