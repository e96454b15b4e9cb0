"""`dohyo networks`: map, check, import and build."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from dohyo.service.cli.output import DASH, Json, console, print_json, print_rows
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.drawing import write_map
from dohyo.sumo_networks.networks.entries import network_entry, network_names
from dohyo.sumo_networks.networks.importing import build_network, import_network
from dohyo.sumo_networks.networks.inspection import NetworkReport, inspect_network
from dohyo.sumo_networks.networks.xml_guard import LIMIT_MB

SHOWN = 6

Network = Annotated[str, typer.Argument(help="Name in the catalog, or path of a .net.xml[.gz].")]


def show(
    name: Network,
    out: Annotated[Path | None, typer.Option(help="A .png, .svg or .html file; default: NAME.html.")] = None,
) -> None:
    """Draws a network as a road map."""
    network = load_network(name)
    path = write_map(network, out or Path(f"{network.name}.html"))
    console.print(f"map: {path.resolve()}", soft_wrap=True)


def check(name: Network, json: Json = False) -> None:
    """Reports a network's size, and faults that would disturb a driver."""
    guessed = network_entry(name).guessed if name in network_names() else ()
    _print_report(inspect_network(load_network(name), guessed), json)


def import_file(
    file: Annotated[Path, typer.Argument(help=".net.xml, .osm[.xml] or .xodr, each also with .gz.")],
    name: Annotated[str, typer.Option(help="Its name: small letters, digits and hyphens.")],
    lights: Annotated[bool, typer.Option("--lights", help="Guess traffic lights at large junctions.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace your network of this name.")] = False,
    limit_mb: Annotated[float, typer.Option(min=0.001, help="Largest size, packed or unpacked, MB.")] = LIMIT_MB,
    licence: Annotated[str | None, typer.Option(help="Of the source's data.")] = None,
    json: Json = False,
) -> None:
    """Imports a road network into your catalog, and checks it."""
    done = import_network(file, name, lights=lights, force=force, limit_mb=limit_mb, licence=licence)
    _print_report(done.report, json)
    if not json:
        console.print(f"network '{name}': {done.folder.resolve()}", soft_wrap=True)


def build(
    folder: Annotated[Path, typer.Argument(help="Holds NAME.netccfg and plain XML, and is called NAME.")],
    out: Annotated[Path | None, typer.Option(help="The net to write; default: FOLDER/NAME.net.xml.")] = None,
) -> None:
    """Builds a network from plain XML; the same source gives the same bytes."""
    console.print(f"net: {build_network(folder, out).resolve()}", soft_wrap=True)


def _print_report(report: NetworkReport, as_json: bool) -> None:
    if as_json:
        print_json(report.as_document())
        return
    kinds = Counter(fault.kind for fault in report.faults)
    print_rows(
        (report.name, ""),
        [
            ("lanes", f"{report.lanes}, {report.lane_km:.1f} km; roads {report.road_km:.1f} km"),
            ("junctions", ", ".join(f"{count} {kind}" for kind, count in report.junctions.items()) or DASH),
            ("lights, stop signs, crossings", f"{report.lights}, {report.stop_signs}, {report.crossings}"),
            ("sidewalks", f"along {report.sidewalk_share:.0%} of the roads"),
            ("limits", ", ".join(f"{km:.1f} km at {limit} km/h" for limit, km in report.speed_limits_kmh.items())),
            ("every lane leads to every other", f"{report.connected_share:.0%} of the lanes"),
            ("outside of these", _some(report.outside)),
            ("dead ends", _some(report.dead_ends)),
            ("suspicious geometry", ", ".join(f"{count} {kind}" for kind, count in kinds.items()) or DASH),
            *((fault.kind, f"{fault.lane}: {fault.value:g} {_unit(fault.kind)}") for fault in report.faults[:SHOWN]),
            *(("guessed" if number == 0 else "", line) for number, line in enumerate(report.guessed)),
        ],
    )


def _unit(kind: str) -> str:
    return {"short": "m long", "kink": "degrees", "curvature": "m of radius"}[kind]


def _some(names: tuple[str, ...]) -> str:
    if not names:
        return DASH
    more = f", and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return f"{len(names)} edges: {', '.join(names[:SHOWN])}{more}"
