"""`dohyo benchmarks prepare`: recorded runs and freeway days of a benchmark."""

from __future__ import annotations

import os
from typing import Annotated

import typer
from rich.progress import MofNCompleteColumn, Progress

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.traffic_logs import prepare_logs
from dohyo.evaluation.freeway.benchmark import is_freeway_benchmark
from dohyo.evaluation.parking.benchmark import is_parking_benchmark
from dohyo.service.cli.commands.freeway import prepare_days
from dohyo.service.cli.output import console
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.simulation.traffic_log import logs_folder


def prepare(
    name: Annotated[str, typer.Argument(help="Name, or path of a .toml file.")],
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; default: one per CPU.")] = None,
) -> None:
    """Makes a benchmark's recorded runs or days. Run again, it continues where it stopped."""
    if is_freeway_benchmark(name):
        prepare_days(name, workers or os.cpu_count() or 1)
        return
    if is_parking_benchmark(name):
        raise InvalidInputError(f"benchmark '{name}' has nothing to prepare: its lots are drawn from their seeds")
    benchmark = load_benchmark(name)
    scenarios = benchmark.scenarios([0])
    with Progress(*Progress.get_default_columns(), MofNCompleteColumn(), console=console) as bar:
        task = bar.add_task(f"logs of {name}", total=None)
        made = prepare_logs(
            scenarios,
            benchmark.reference_agent,
            workers or os.cpu_count() or 1,
            lambda done, total: bar.update(task, completed=done, total=total),
        )
    logs = sum(scenario.log is not None for scenario in scenarios)
    console.print(f"{made} made, {logs - made} kept, in {logs_folder()}")
