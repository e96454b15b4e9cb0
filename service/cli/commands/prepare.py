"""`dohyo benchmarks prepare`: recorded runs and freeway days of a benchmark."""

from __future__ import annotations

from typing import Annotated

import typer

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.documents import find_family
from dohyo.evaluation.benchmarks.traffic_logs import prepare_logs
from dohyo.evaluation.families import Family
from dohyo.service.cli.commands.freeway import prepare_days
from dohyo.service.cli.output import console
from dohyo.service.cli.progress import ProgressBar, ended_by_sigterm
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.processes import usable_processors
from dohyo.sumo_networks.simulation.traffic_log import logs_folder


def prepare(
    name: Annotated[str, typer.Argument(help="Name, or path of a .toml file.")],
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; default: one per CPU.")] = None,
) -> None:
    """Makes a benchmark's recorded runs or days. Run again, it continues where it stopped."""
    processes = workers or usable_processors()
    match find_family(name):
        case Family.FREEWAY | Family.FORECASTING:
            prepare_days(name, processes)
        case Family.PARKING:
            raise InvalidInputError(f"benchmark '{name}' has nothing to prepare: its lots are drawn from their seeds")
        case Family.DRIVING:
            _prepare_logs(name, processes)


def _prepare_logs(name: str, workers: int) -> None:
    """Makes the missing logs of a benchmark's recorded runs."""
    benchmark = load_benchmark(name)
    scenarios = benchmark.scenarios([0])
    with ended_by_sigterm(), ProgressBar(f"logs of {name}") as bar:
        made = prepare_logs(scenarios, benchmark.reference_agent, workers, bar)
    logs = sum(scenario.log is not None for scenario in scenarios)
    console.print(f"{made} made, {logs - made} kept, in {logs_folder()}")
