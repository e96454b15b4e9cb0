"""Options of the commands that build an agent from a record: which code it may run here."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dohyo.evaluation.agent import Agent
from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord
from dohyo.service.cli.own_modules import find_own_modules
from dohyo.service.episodes.recorded_agents import UntrustedRecordError, build_agents, check_known
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.entries import network_names

Trust = Annotated[
    bool,
    typer.Option(
        "--trust",
        help="Build whatever agent, settings and network the record names. This runs its author's choice of code on "
        "this machine, with your rights: use it only for records that you made, or whose author you trust.",
    ),
]
Policy = Annotated[
    Path | None, typer.Option(help="ONNX file of the record's policy, if a policy drove.", dir_okay=False, exists=True)
]


def trusted_agents(record: EpisodeRecord, path: Path, trust: bool, policy: Path | None) -> dict[str, Agent]:
    """The agents of a record, see `build_agents`; with `trust` also those in the current folder.

    Raises:
        InvalidInputError: As for `build_agents`; the message names the record and the option.
    """
    if trust:
        find_own_modules()
    try:
        return build_agents(record, trust=trust, policy=policy)
    except UntrustedRecordError as error:
        raise UntrustedRecordError(f"'{path}': {error} (--trust runs whatever the record names)") from error
    except InvalidInputError as error:
        raise InvalidInputError(f"'{path}': {error}") from error


def check_trusted(agent: AgentInfo, path: Path, trust: bool) -> None:
    """Checks that the agent of a record of parking or forecasts may be built; with `trust`, any agent may.

    Raises:
        InvalidInputError: As for `check_known`; the message names the record and the option.
    """
    if trust:
        find_own_modules()
        return
    try:
        check_known(agent)
    except UntrustedRecordError as error:
        raise UntrustedRecordError(f"'{path}': {error} (--trust runs whatever the record names)") from error


def check_networks(benchmark: Benchmark, path: Path, trust: bool) -> None:
    """Checks that the networks of the benchmark of a record may be read; with `trust`, any may.

    Raises:
        UntrustedRecordError: One is not in the catalog here: it may be any file.
    """
    known = network_names()
    if not trust and (others := [name for name in benchmark.networks if name not in known]):
        raise UntrustedRecordError(
            f"'{path}': network '{others[0]}' of its benchmark is not in the catalog here (--trust reads it)"
        )
