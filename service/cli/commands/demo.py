"""`dohyo demo`: from a city's file to a report of two agents, by one command."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from dohyo.agents.registry import kind_of, resolve_with
from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.benchmarks.cells import Level, traffic_of
from dohyo.evaluation.benchmarks.creation import create_benchmark
from dohyo.evaluation.benchmarks.writing import write_benchmark
from dohyo.evaluation.running.executors import ProcessPool
from dohyo.evaluation.running.run import run_benchmark
from dohyo.service.cli.commands.create import notes_of, print_created
from dohyo.service.cli.commands.records import report
from dohyo.service.cli.output import console
from dohyo.service.cli.progress import ProgressBar, ended_by_sigterm, named_steps
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.entries import network_entry, network_names
from dohyo.sumo_networks.networks.importing import import_network
from dohyo.sumo_networks.networks.parsing import file_hash
from dohyo.sumo_networks.processes import usable_processors

AGENTS = ("autopilot", "reckless")
SEEDS = (0, 1)
FEWEST, MOST = 2, 6
# Measured on one processor of 2026: time of a tick without traffic, and for each vehicle or pedestrian more.
TICK_COST_S, ACTOR_COST_S = 2.5e-3, 3e-5
USUAL_TICKS = 900
BUDGET_S = 200.0
"""Processor seconds for all drives: those of two processors in three minutes, less import, trial and report."""


def demo(
    city: Annotated[str, typer.Argument(help="An .osm, .net.xml or .xodr file, also packed, or a .pbf; or a network.")],
    name: Annotated[str | None, typer.Option(help="Of the network in your catalog; default: the file's.")] = None,
    missions: Annotated[
        int | None, typer.Option(min=1, max=1000, help="Number of missions to draw; default: 6, fewer in much traffic.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of all results; default: out/demo/NAME.")] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; default: one per CPU.")] = None,
) -> None:
    """From a city's file to a report: imports, draws missions, drives two agents. Run again, it continues."""
    network = city if city in network_names() else _imported(Path(city), name)
    folder = out or Path("out") / "demo" / network
    wanted = missions or _fitting_missions(network)
    made = create_benchmark(network, network, missions=wanted, fewer=missions is None, seeds=SEEDS)
    print_created(made)
    benchmark = write_benchmark(made.benchmark, folder / f"{network}.toml", notes_of(made))
    console.print(f"benchmark: {benchmark.resolve()}")
    for agent in AGENTS:
        _drive(agent, made.benchmark, folder / agent, workers or usable_processors())
    report([folder / agent for agent in AGENTS], folder / "report.html")


def _fitting_missions(network: str) -> int:
    """Number of missions whose drives take about three minutes on two processors: 2 to 6, by the traffic."""
    traffic = traffic_of(load_network(network), Level.REGULAR)
    actors = traffic.vehicles + traffic.pedestrians
    mission_s = len(AGENTS) * len(SEEDS) * USUAL_TICKS * (TICK_COST_S + ACTOR_COST_S * actors)
    return max(FEWEST, min(MOST, int(BUDGET_S / mission_s)))


def _imported(file: Path, name: str | None) -> str:
    """Name of the file's network in the catalog; imports it unless an earlier call did.

    Raises:
        InvalidInputError: The file cannot be imported, or the name is that of another network.
    """
    digest = file_hash(file)
    name = name or _catalog_name(file)
    if name in network_names():
        if network_entry(name).source_sha256 == digest:
            return name
        raise InvalidInputError(f"network '{name}' exists and comes from other data than '{file}'; choose a --name")
    console.print(f"importing {file}")
    with ended_by_sigterm(), named_steps() as progress:
        done = import_network(file, name, progress=progress)
    console.print(
        f"network '{name}': {done.report.lanes} lanes, {done.report.lane_km:.1f} km, {done.report.lights} traffic "
        f"lights; {done.report.connected_share:.0%} of the lanes lead to each other",
    )
    return name


def _catalog_name(file: Path) -> str:
    """A name for the catalog, made from that of a file."""
    stem = file.name.split(".")[0].lower()
    return re.sub(r"[^a-z0-9]+", "-", stem).strip("-")[:63] or "city"


def _drive(agent: str, benchmark: Benchmark, folder: Path, workers: int) -> None:
    entry, settings = resolve_with(agent, {})
    with ProgressBar(f"{agent} on {benchmark.name}") as bar:
        run_benchmark(
            benchmark,
            entry,
            settings=settings,
            kind=kind_of(entry, settings),
            out=folder,
            executor=ProcessPool(workers),
            progress=lambda _, done, total: bar(done, total),
        )
