"""`dohyo agents`, `dohyo benchmarks`: what there is."""

from __future__ import annotations

import os
from typing import Annotated, Any

import typer
from rich.progress import MofNCompleteColumn, Progress

from dohyo.agents.registry import agent_entries
from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.benchmarks.benchmark import benchmark_names, load_benchmark
from dohyo.evaluation.benchmarks.traffic_logs import prepare_logs
from dohyo.evaluation.freeway.benchmark import is_freeway_benchmark
from dohyo.service.cli.freeway import freeway_rows, prepare_days
from dohyo.service.cli.output import console, print_json, print_rows
from dohyo.sumo_networks.simulation.traffic_log import logs_folder

agents = typer.Typer(help="Driving agents.", no_args_is_help=True)
benchmarks = typer.Typer(help="Benchmarks.", no_args_is_help=True)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]


@agents.callback()
@benchmarks.callback()
def _group() -> None:
    """Keeps `list` a subcommand although it is the only one."""


@agents.command("list")
def list_agents(json: Json = False) -> None:
    """Lists the registered agents."""
    rows: list[dict[str, Any]] = []
    for name, entry in agent_entries().items():
        spec = make_agent(entry).spec
        rows.append(
            {
                "name": name,
                "track": spec.track,
                "sensors": list(spec.sensors),
                "control": spec.control,
                "entry": entry,
            }
        )
    if json:
        print_json(rows)
        return
    print_rows(
        ("name", "track", "control", "sensors"),
        [(row["name"], row["track"], row["control"], ", ".join(row["sensors"])) for row in rows],
    )


@benchmarks.command("prepare")
def prepare(
    name: Annotated[str, typer.Argument(help="Name, or path of a .toml file.")],
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; default: one per CPU.")] = None,
) -> None:
    """Makes the recorded runs that a benchmark replays, or its days; the same command goes on where it stopped."""
    if is_freeway_benchmark(name):
        prepare_days(name, workers or os.cpu_count() or 1)
        return
    scenarios = load_benchmark(name).scenarios([0])
    with Progress(*Progress.get_default_columns(), MofNCompleteColumn(), console=console) as bar:
        task = bar.add_task(f"logs of {name}", total=None)
        made = prepare_logs(
            scenarios, workers or os.cpu_count() or 1, lambda done, total: bar.update(task, completed=done, total=total)
        )
    logs = sum(scenario.log is not None for scenario in scenarios)
    console.print(f"{made} made, {logs - made} there before, in {logs_folder()}")


@benchmarks.command("list")
def list_benchmarks(json: Json = False) -> None:
    """Lists the benchmarks."""
    rows: list[dict[str, Any]] = []
    for name in benchmark_names():
        benchmark = load_benchmark(name)
        rows.append(
            {
                "name": name,
                "version": benchmark.sha256[:12],
                "cells": len(benchmark.cells),
                "scenarios": sum(len(benchmark.missions[cell.missions]) for cell in benchmark.cells),
                "networks": list(benchmark.networks),
                "headline": benchmark.headline.label,
                "metric": benchmark.metric,
                "description": benchmark.description,
            }
        )
    rows += freeway_rows()
    if json:
        print_json(rows)
        return
    print_rows(
        ("name", "scenarios", "ranked by", "description"),
        [
            *((row["name"], str(row["scenarios"]), row["headline"], row["description"]) for row in rows),
            ("localization", "", "share within 0.5 m", "Filters on simulated logs, no agent: dohyo localize --study"),
        ],
    )
