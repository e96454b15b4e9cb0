"""`dohyo benchmarks create`: a benchmark on any network, with missions drawn there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from dohyo.evaluation.benchmarks.benchmark import AutoEvents
from dohyo.evaluation.benchmarks.cells import Level, Protocol
from dohyo.evaluation.benchmarks.creation import Created, create_benchmark
from dohyo.evaluation.benchmarks.documents import benchmark_names
from dohyo.evaluation.benchmarks.writing import write_benchmark
from dohyo.evaluation.families import Family
from dohyo.service.cli.output import Json, console, print_json
from dohyo.service.cli.seeds import parse_seeds
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError


def create(
    name: Annotated[str, typer.Argument(help="Name of the benchmark.")],
    network: Annotated[str, typer.Option(help="Name in the catalog, or path of a .net.xml[.gz].")],
    missions: Annotated[int, typer.Option(min=1, max=1000, help="Number of missions to draw.")] = 25,
    length: Annotated[
        str | None, typer.Option(help="Of the routes, m, such as 300-1500; default: that, or what the network has.")
    ] = None,
    traffic: Annotated[str, typer.Option(help="empty, regular or dense; several give a cell each.")] = "regular",
    conditions: Annotated[
        str, typer.Option(help="Groups train and test, a cell each; or names, such as clear,wet.")
    ] = "clear",
    protocol: Annotated[Protocol, typer.Option(help="Rules by which agents are ranked.")] = Protocol.LEADERBOARD,
    events: Annotated[str | None, typer.Option(help="auto, or kinds of scripted events; default: none.")] = None,
    seeds: Annotated[str, typer.Option(help="That are driven by default, such as 0,1,2 or 0-4.")] = "0-2",
    seed: Annotated[int, typer.Option(min=0, help="Of the drawing; the same seed gives the same file.")] = 0,
    out: Annotated[Path | None, typer.Option(help="The .toml to write; default: NAME.toml.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    json: Json = False,
) -> None:
    """Creates a benchmark on any network: draws missions, and writes one TOML file."""
    if name in benchmark_names(Family.DRIVING):
        raise InvalidInputError(f"benchmark '{name}' comes with dohyo; choose another name")
    path = free_path(out or Path(f"{name}.toml"), force)
    made = create_benchmark(
        name,
        network,
        missions=missions,
        length_m=parse_length(length) if length is not None else None,
        traffic=parse_levels(traffic),
        conditions=parse_names(conditions),
        protocol=protocol,
        events=parse_events(events) if events is not None else None,
        seeds=parse_seeds(seeds),
        drawing_seed=seed,
    )
    write_benchmark(made.benchmark, path, notes=notes_of(made))
    if json:
        print_json({"benchmark": str(path), "version": made.benchmark.sha256[:12]} | as_document(made))
        return
    print_created(made)
    console.print(f"benchmark: {path.resolve()}")
    console.print(f"drive it: dohyo evaluate --agent autopilot --benchmark {path}")


def free_path(path: Path, force: bool) -> Path:
    """The path, if a benchmark may be written there.

    Raises:
        InvalidInputError: A file exists, and is not to be replaced.
    """
    if path.exists() and not force:
        raise InvalidInputError(f"'{path}' exists; replace it with --force, or choose another --out")
    return path


def notes_of(made: Created) -> dict[str, str]:
    """Comments of the missions in the file."""
    return {one.mission.name: one.summary for one in made.drawing.missions}


def as_document(made: Created) -> dict[str, object]:
    """Missions and what was left out, as plain JSON."""
    missions = [
        {"name": one.mission.name, "length_m": round(one.route.length, 1), "lights": one.lights, "turns": one.all_turns}
        for one in made.drawing.missions
    ]
    return {"missions": missions, "left_out": dict(made.drawing.left_out)}


def print_created(made: Created) -> None:
    """Prints what was drawn, and the routes that make no missions."""
    drawn, benchmark = made.drawing.missions, made.benchmark
    console.print(f"{benchmark.description}: {benchmark.size} drives per seed", highlight=False)
    turns, lights = [one.all_turns for one in drawn], [one.lights for one in drawn]
    console.print(
        f"per mission {min(turns)} to {max(turns)} turns, {min(lights)} to {max(lights)} traffic lights",
        highlight=False,
    )
    for cell in benchmark.cells:
        traffic = f"{cell.traffic.vehicles} vehicles and {cell.traffic.pedestrians} pedestrians"
        where = "" if len(benchmark.cells) == 1 else f"{cell.name}: "
        console.print(f"{where}{traffic}, {', '.join(cell.conditions)}", highlight=False)
    for level, vehicles in made.reduced.items():
        console.print(f"{level} traffic is reduced: {vehicles} vehicles jam this network")
    if made.reduced:
        network = benchmark.cells[0].network
        console.print(f"look for the cause: dohyo networks check {network}; import --fix mends lights")
    for reason, number in made.drawing.left_out.items():
        console.print(f"left out: {number} routes, {reason}", highlight=False)


def parse_length(text: str) -> tuple[float, float]:
    """Shortest and longest route [m] from text such as "300-1500"."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*-\s*(\d+(?:\.\d+)?)\s*", text)
    if not match or not float(match[2]) > 0 or float(match[1]) > float(match[2]):
        raise InvalidInputError(f"--length '{text}': expected two lengths in metres, such as 300-1500")
    return float(match[1]), float(match[2])


def parse_levels(text: str) -> list[Level]:
    """Amounts of traffic from text such as "empty,regular"."""
    levels = []
    for part in parse_names(text):
        if part not in list(Level):
            raise UnknownNameError("amount of traffic", part, Level)
        levels.append(Level(part))
    return levels


def parse_events(text: str) -> AutoEvents:
    """Rules of placement from "auto" or kinds of events."""
    return AutoEvents() if text == "auto" else AutoEvents(kinds=tuple(parse_names(text)))


def parse_names(text: str) -> list[str]:
    """The different names between commas, in their order."""
    parts = list(dict.fromkeys(part.strip() for part in text.split(",")))
    if not all(parts):
        raise InvalidInputError(f"'{text}': expected names, separated by commas")
    return parts
