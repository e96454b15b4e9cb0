"""`dohyo benchmarks import`: a benchmark from a CARLA route file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dohyo.evaluation.benchmarks.carla_routes import MAX_SNAP_M, import_routes
from dohyo.evaluation.benchmarks.writing import write_benchmark
from dohyo.service.cli.output import Json, console, print_json, print_rows
from dohyo.sumo_networks.scenario import Traffic


def import_file(
    file: Annotated[Path, typer.Argument(help="CARLA route file, .xml.")],
    network: Annotated[str, typer.Option(help="Name of the imported network of the town.")],
    name: Annotated[str | None, typer.Option(help="Name of the benchmark; default: the file's name.")] = None,
    town: Annotated[str | None, typer.Option(help="Only the routes of this town, such as Town01.")] = None,
    vehicles: Annotated[int, typer.Option(min=0, help="Number around every route.")] = 0,
    pedestrians: Annotated[int, typer.Option(min=0, help="Number around every route.")] = 0,
    max_snap: Annotated[float, typer.Option(min=0, help="Largest distance of a waypoint from a lane, m.")] = MAX_SNAP_M,
    out: Annotated[Path | None, typer.Option(help="The .toml to write; default: NAME.toml.")] = None,
    json: Json = False,
) -> None:
    """Makes a benchmark of the routes in a CARLA route file, one mission per route."""
    traffic = Traffic(vehicles=vehicles, pedestrians=pedestrians)
    benchmark, snaps = import_routes(file, network, name=name, town=town, traffic=traffic, max_snap_m=max_snap)
    path = write_benchmark(benchmark, out or Path(f"{benchmark.name}.toml"))
    if json:
        print_json({"benchmark": str(path), "routes": [snap.as_document() for snap in snaps]})
        return
    print_rows(
        ("route", "waypoints", "moved m, mean", "at most", "unused"),
        [
            (snap.mission, str(len(snap.moved_m)), f"{snap.mean_m:.2f}", f"{max(snap.moved_m):.2f}", str(snap.unused))
            for snap in snaps
        ],
    )
    console.print(f"benchmark: {path.resolve()}", soft_wrap=True)
