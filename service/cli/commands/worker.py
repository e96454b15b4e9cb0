"""`dohyo worker`: drives an agent's episodes for a service, from this machine."""

from __future__ import annotations

import logging
from typing import Annotated

import typer

from dohyo.agents.registry import describe_agent, resolve_with
from dohyo.service.cli.commands.evaluate import parse_settings
from dohyo.service.cli.own_modules import find_own_modules
from dohyo.service.client.client import Client
from dohyo.service.client.worker import Driver, keep_working, work
from dohyo.service.client.worker_session import WorkerSession

TOKEN = "DOHYO_TOKEN"


def worker(
    server: Annotated[
        str, typer.Option(envvar="DOHYO_SERVER", help="Address of the service, such as http://127.0.0.1:8000.")
    ],
    agent: Annotated[str, typer.Option(help="Its name at the service.")],
    token: Annotated[str, typer.Option(envvar=TOKEN, help="Token of role worker; of role submitter, to submit too.")],
    entry: Annotated[str | None, typer.Option(help="Registered name or module:Class here; default: --agent.")] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value for the agent; repeatable.")] = None,
    capacity: Annotated[int, typer.Option(min=1, max=64, help="Episodes at once, one process each.")] = 1,
    episodes: Annotated[int | None, typer.Option(min=1, help="Number of episodes to drive; default: no end.")] = None,
) -> None:
    """Drives an agent's episodes for a service until stopped. Submits the agent first if needed."""
    logging.basicConfig(format="dohyo worker: %(message)s", level=logging.INFO)
    logging.getLogger("httpx").setLevel(logging.WARNING)
    find_own_modules()
    resolved, given = resolve_with(entry or agent, parse_settings(settings or []))
    info = describe_agent(resolved, given, "remote")
    with Client(server, token) as client:
        version = client.ensure_remote(agent, info)
    logging.getLogger("dohyo.worker").info("agent '%s', version %d, for %s", agent, version, server)
    if capacity == 1:
        work(WorkerSession(server, token, agent, version=version), Driver(resolved, given), episodes)
        return
    command = ["-c", "from dohyo.service.cli import main; main()", "worker", "--server", server, "--agent", agent]
    command += ["--entry", entry or agent, *[part for pair in settings or [] for part in ("--set", pair)]]
    command += ["--episodes", str(episodes)] if episodes is not None else []
    keep_working(command, capacity, {TOKEN: token})  # arguments are readable by all users of this machine
