"""`dohyo networks`: map, check, import and build."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dohyo.service.cli.output import DASH, Json, console, print_json, print_rows
from dohyo.service.cli.progress import ended_by_sigterm, named_steps
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.conversion.source_file import ImportOptions
from dohyo.sumo_networks.networks.drawing import write_map
from dohyo.sumo_networks.networks.entries import network_entry, network_names, network_path
from dohyo.sumo_networks.networks.faults import MEANINGS, FaultKind
from dohyo.sumo_networks.networks.importing import build_network, import_network
from dohyo.sumo_networks.networks.inspection import NetworkReport, inspect_network
from dohyo.sumo_networks.networks.xml_guard import LIMIT_MB

if TYPE_CHECKING:
    from dohyo.evaluation.benchmarks.creation import Capacity

SHOWN = 6
WELL_CONNECTED = 0.9

Network = Annotated[str, typer.Argument(help="Name in the catalog, or path of a .net.xml[.gz].")]


def show(
    name: Network,
    out: Annotated[Path | None, typer.Option(help="A .png, .svg or .html file; default: NAME.html.")] = None,
) -> None:
    """Draws a network as a road map."""
    network = load_network(name)
    path = write_map(network, out or Path(f"{network.name}.html"))
    console.print(f"map: {path.resolve()}")


def check(
    name: Network,
    traffic: Annotated[bool, typer.Option("--traffic", help="Try how many vehicles the network carries.")] = False,
    json: Json = False,
) -> None:
    """Reports a network's size, faults that would disturb a driver, and how much traffic it carries."""
    guessed = network_entry(name).guessed if name in network_names() else ()
    report = inspect_network(load_network(name), guessed)
    capacity = _capacity(name) if traffic else None
    if json:
        print_json(report.as_document() | ({"capacity": asdict(capacity)} if capacity else {}))
        return
    _print_report(report)
    if capacity:
        console.print(
            f"carries about {capacity.carried} vehicles, {capacity.per_km:g} per km of lanes; dense traffic has "
            f"{capacity.wanted}",
        )


def _capacity(name: str) -> Capacity:
    from dohyo.evaluation.benchmarks.creation import estimate_capacity  # loads SUMO

    return estimate_capacity(name)


def import_file(
    file: Annotated[Path, typer.Argument(help=".net.xml, .osm or .xodr, also packed; .pbf; or a network's name.")],
    name: Annotated[str, typer.Option(help="Its name: small letters, digits and hyphens.")],
    lights: Annotated[bool, typer.Option("--lights", help="Guess traffic lights at large junctions.")] = False,
    left_hand: Annotated[
        bool | None,
        typer.Option("--left-hand/--right-hand", help="Side of the traffic; default: as in the country."),
    ] = None,
    country: Annotated[
        str | None, typer.Option(help="Two letters, such as GB: side and limits; default: from the coordinates.")
    ] = None,
    largest_part: Annotated[
        bool, typer.Option("--largest-part", help="Keep only roads that lead to each other.")
    ] = False,
    fix: Annotated[bool, typer.Option("--fix", help="Mend lights and implausible limits; the report lists them.")] = (
        False
    ),
    force: Annotated[bool, typer.Option("--force", help="Replace your network of this name.")] = False,
    limit_mb: Annotated[float, typer.Option(min=0.001, help="Largest size, packed or unpacked, MB.")] = LIMIT_MB,
    licence: Annotated[str | None, typer.Option(help="Of the source's data.")] = None,
    json: Json = False,
) -> None:
    """Imports a road network into your catalog, and checks it."""
    known = network_entry(str(file)) if str(file) in network_names() else None
    options = ImportOptions(
        lights=lights,
        left_hand=left_hand,
        country=country,
        largest_part=largest_part,
        fix=fix,
        limit_mb=limit_mb,
        licence=licence or (known.licence if known else None),
        mirrored=known is not None and known.mirrored,
    )
    source = network_path(str(file)) if known else file
    with ended_by_sigterm(), named_steps() as progress:
        done = import_network(source, name, options, force=force, progress=progress)
    if json:
        print_json(done.report.as_document())
    else:
        _print_report(done.report)
        console.print(f"network '{name}': {done.folder.resolve()}")


def build(
    folder: Annotated[Path, typer.Argument(help="Holds NAME.netccfg and plain XML, and is called NAME.")],
    out: Annotated[Path | None, typer.Option(help="The net to write; default: FOLDER/NAME.net.xml.")] = None,
) -> None:
    """Builds a network from plain XML; the same source gives the same bytes."""
    console.print(f"net: {build_network(folder, out).resolve()}")


def _print_report(report: NetworkReport) -> None:
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
            *_fault_rows(report),
            *(("guessed" if number == 0 else "", line) for number, line in enumerate(report.guessed)),
        ],
    )
    if report.connected_share < WELL_CONNECTED:
        console.print("few lanes lead to each other: import with --largest-part keeps only these")


def _fault_rows(report: NetworkReport) -> Iterator[tuple[str, str]]:
    """Some places of each kind of fault, and the remedy."""
    if not report.faults:
        yield "faults", DASH
    for kind in FaultKind:
        faults = [fault for fault in report.faults if fault.kind is kind]
        for number, fault in enumerate(faults[:SHOWN]):
            yield f"{len(faults)} x {kind}" if number == 0 else "", fault.summary
        if faults:
            yield "", f"remedy: {MEANINGS[kind].remedy}"


def _some(names: tuple[str, ...]) -> str:
    if not names:
        return DASH
    more = f", and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return f"{len(names)} edges: {', '.join(names[:SHOWN])}{more}"
