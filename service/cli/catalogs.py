"""`dohyo agents`, `dohyo benchmarks`: what there is."""

from __future__ import annotations

from typing import Annotated

import typer

from agents.registry import agent_entries
from evaluation.agent import make_agent
from evaluation.benchmark import benchmark_names, load_benchmark
from service.cli.output import print_listing

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
    rows = []
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
    print_listing(rows, json)


@benchmarks.command("list")
def list_benchmarks(json: Json = False) -> None:
    """Lists the benchmarks."""
    rows = []
    for name in benchmark_names():
        benchmark = load_benchmark(name)
        rows.append(
            {
                "name": name,
                "version": benchmark.sha256[:12],
                "cells": len(benchmark.cells),
                "scenarios": sum(len(benchmark.missions[cell.missions]) for cell in benchmark.cells),
                "networks": list(benchmark.networks),
                "metric": benchmark.metric,
                "description": benchmark.description,
            }
        )
    print_listing(rows, json)
