"""`dohyo benchmarks import`: a benchmark from a CARLA route file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dohyo.evaluation.benchmarks.carla_routes import MAX_SNAP_M, ImportedRoutes, import_routes
from dohyo.evaluation.benchmarks.cells import Protocol
from dohyo.evaluation.benchmarks.writing import write_benchmark
from dohyo.service.cli.commands.create import free_path, parse_levels, parse_names
from dohyo.service.cli.output import Json, console, print_json, print_rows
from dohyo.service.cli.seeds import parse_seeds
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Traffic


def import_file(
    file: Annotated[Path, typer.Argument(help="CARLA route file, .xml.")],
    network: Annotated[str, typer.Option(help="Name of the imported network of the town.")],
    name: Annotated[str | None, typer.Option(help="Name of the benchmark; default: the file's name.")] = None,
    town: Annotated[str | None, typer.Option(help="Only the routes of this town, such as Town01.")] = None,
    protocol: Annotated[Protocol, typer.Option(help="Rules by which agents are ranked.")] = Protocol.LEADERBOARD,
    traffic: Annotated[
        str | None, typer.Option(help="empty, regular or dense; several give a cell each; default: empty.")
    ] = None,
    conditions: Annotated[
        str, typer.Option(help="Groups train and test, a cell each; or names, such as clear,wet.")
    ] = "clear",
    seeds: Annotated[str, typer.Option(help="That are driven by default, such as 0,1,2 or 0-4.")] = "0",
    vehicles: Annotated[int, typer.Option(min=0, help="Number around every route.")] = 0,
    pedestrians: Annotated[int, typer.Option(min=0, help="Number around every route.")] = 0,
    max_snap: Annotated[float, typer.Option(min=0, help="Largest distance of a waypoint from a lane, m.")] = MAX_SNAP_M,
    skip: Annotated[bool, typer.Option("--skip", help="Leave out routes that make no mission, with a list.")] = False,
    out: Annotated[Path | None, typer.Option(help="The .toml to write; default: NAME.toml.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    json: Json = False,
) -> None:
    """Makes a benchmark of the routes in a CARLA route file, one mission per route."""
    if traffic is not None and (vehicles or pedestrians):
        raise InvalidInputError("expected either --traffic or --vehicles and --pedestrians, got both")
    if out is not None:
        free_path(out, force)
    made = import_routes(
        file,
        network,
        name=name,
        town=town,
        traffic=parse_levels(traffic) if traffic is not None else Traffic(vehicles=vehicles, pedestrians=pedestrians),
        conditions=parse_names(conditions),
        protocol=protocol,
        seeds=parse_seeds(seeds),
        max_snap_m=max_snap,
        skip=skip,
    )
    path = write_benchmark(made.benchmark, free_path(out or Path(f"{made.benchmark.name}.toml"), force))
    if json:
        routes = [snap.as_document() for snap in made.snaps]
        print_json({"benchmark": str(path), "routes": routes, "skipped": dict(made.skipped)})
        return
    _print_routes(made)
    console.print(f"benchmark: {path.resolve()}")


def _print_routes(made: ImportedRoutes) -> None:
    print_rows(
        ("route", "waypoints", "moved m, mean", "at most", "unused"),
        [
            (snap.mission, str(len(snap.moved_m)), f"{snap.mean_m:.2f}", f"{max(snap.moved_m):.2f}", str(snap.unused))
            for snap in made.snaps
        ],
    )
    for snap in made.snaps:
        for note in snap.notes:
            console.print(f"{snap.mission}: {note}")
    for route, reason in made.skipped.items():
        console.print(f"skipped route {route}: {reason}")
    for level, number in made.reduced.items():
        console.print(f"{level} traffic is reduced: {number} vehicles jam this network")
