"""netconvert: SUMO's program that makes nets, and the options by which dohyo runs it."""

from __future__ import annotations

import os
import re
import subprocess
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import sumo

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.conversion.countries import Country
from dohyo.sumo_networks.networks.conversion.sources import Kind
from dohyo.sumo_networks.units import KMH_PER_MPS

TIMEOUT_S = 600.0
LONGEST_CYCLE_S = 150.0
"""A driver who waits at a red light for 180 s counts as blocked."""
JOIN_LIGHTS, DROP_SIMPLE_LIGHTS, DROP_ISOLATED = "--tls.join", "--tls.discard-simple", "--remove-edges.isolated"
LINK_KMH = 60.0
_INPUT: dict[Kind, str] = {"net": "-s", "osm": "--osm-files", "xodr": "--opendrive-files"}
_TYPE_MAPS: dict[Kind, tuple[str, ...]] = {
    "net": (),
    "osm": ("osmNetconvert", "osmNetconvertUrbanDe", "osmNetconvertPedestrians"),
    "xodr": ("opendriveNetconvert", "opendriveNetconvertPedestrians"),
}
_OPTIONS: dict[Kind, tuple[str, ...]] = {
    "net": ("--no-internal-links", "false"),  # otherwise a net without lanes inside its junctions gets none
    "osm": (
        *("--proj.utm", "--geometry.remove", "--roundabouts.guess", "--ramps.guess", "--junctions.join"),
        *("--tls.guess-signals", DROP_SIMPLE_LIGHTS, JOIN_LIGHTS, DROP_ISOLATED),
        *("--keep-edges.by-vclass", "passenger,bicycle,pedestrian"),
    ),
    "xodr": ("--opendrive.curve-resolution", "1", "--geometry.min-dist", "0.2"),
}
_GUESS_CROSSINGS = "--crossings.guess"
_GUESSES = (
    *("--sidewalks.guess", "--default.sidewalk-width", "2", "--default.crossing-width", "4"),
    *("--no-turnarounds.except-deadend", "--tls.default-type", "static"),
)
_IN_TOWN = (
    *("trunk", "trunk_link", "primary", "primary_link", "secondary", "secondary_link", "tertiary", "tertiary_link"),
    *("unclassified", "residential"),
)


@dataclass(frozen=True, slots=True)
class Conversion:
    """Settings of a conversion.

    Attributes:
        kind: Kind of the source.
        source: Plain XML to read.
        file: Path that the user gave, for error messages.
        lights: Whether to guess traffic lights at large junctions too.
        crossings: Whether to guess crossings.
        drop_lights: Whether to leave out the lights of an OpenDRIVE file at places where no two roads meet.
        left_hand: Whether traffic drives on the left.
        country: Country whose speed limits hold where a road has none; None: the limits of the type maps.
        timeout_s: Time limit of netconvert, s.
    """

    kind: Kind
    source: Path
    file: Path
    lights: bool
    crossings: bool
    drop_lights: bool
    left_hand: bool
    country: Country | None
    timeout_s: float


def convert(settings: Conversion, target: Path) -> tuple[list[str], list[str]]:
    """Makes a net; repeats it with milder options where netconvert's first answer is of no use.

    Returns:
        netconvert's warnings, and what was decided, one line each.

    Raises:
        InvalidInputError: netconvert fails or takes too long.
    """
    arguments, decided = _arguments(settings, target), []
    if settings.kind == "xodr" and settings.drop_lights:
        decided.append("lights at places where no two roads meet are left out")
    warnings = run_netconvert(arguments, settings.file, settings.timeout_s)
    if DROP_ISOLATED in arguments and not _has_roads(target):
        arguments.remove(DROP_ISOLATED)
        decided.append("roads that are not connected to others are kept, since there are no others")
        warnings = run_netconvert(arguments, settings.file, settings.timeout_s)
    if JOIN_LIGHTS in arguments and (cycle := _longest_cycle(target)) > LONGEST_CYCLE_S:
        arguments.remove(JOIN_LIGHTS)
        decided.append(f"lights of neighbouring junctions stay apart, since one would have a cycle of {cycle:.0f} s")
        warnings = run_netconvert(arguments, settings.file, settings.timeout_s)
    return warnings, decided


def rebuild(net: Path, target: Path, file: Path, options: Iterable[str], timeout_s: float = TIMEOUT_S) -> list[str]:
    """Makes a net of a net with some options; returns netconvert's warnings.

    Raises:
        InvalidInputError: netconvert fails or takes too long.
    """
    return run_netconvert(["-s", str(net), "-o", str(target), *options], file, timeout_s)


def run_netconvert(arguments: Sequence[str], file: Path, timeout_s: float) -> list[str]:
    """Runs netconvert and returns its warnings.

    Args:
        arguments: Command line of netconvert.
        file: Path that the user gave, for error messages.
        timeout_s: Time after which netconvert is stopped, s.

    Raises:
        InvalidInputError: netconvert fails or takes too long.
    """
    always = ["--xml-validation", "never", "--xml-validation.net", "never", "--aggregate-warnings", "-1"]
    try:
        done = run_program("netconvert", [*arguments, *always], timeout_s)
    except subprocess.TimeoutExpired as error:
        raise InvalidInputError(f"'{file}': netconvert did not finish within {timeout_s:.0f} s") from error
    lines = [line for line in (done.stderr + done.stdout).splitlines() if line]
    if done.returncode:
        errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error: ")]
        why = errors[0] if errors else f"it ended with {done.returncode}"
        raise InvalidInputError(f"'{file}': netconvert cannot use the file: {why}")
    return [line.removeprefix("Warning: ") for line in lines if line.startswith("Warning: ")]


def run_program(program: str, arguments: Sequence[str], timeout_s: float) -> subprocess.CompletedProcess[str]:
    """Runs one of SUMO's programs.

    Raises:
        TimeoutExpired: It takes too long.
    """
    home = Path(sumo.SUMO_HOME)
    environment = {**os.environ, "SUMO_HOME": str(home), "PROJ_LIB": str(home / "data" / "proj")}
    command = [str(home / "bin" / program), *arguments]
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, errors="replace", timeout=timeout_s, check=False
    )


def without_comments(net: bytes) -> bytes:
    """Removes netconvert's comment (date and paths) from a net, so that the same source gives the same bytes."""
    return re.sub(rb"\n*<!-- generated on .*?-->\n*", b"\n\n", net, count=1, flags=re.DOTALL)


def _arguments(settings: Conversion, target: Path) -> list[str]:
    maps = [str(Path(sumo.SUMO_HOME) / "data" / "typemap" / f"{name}.typ.xml") for name in _TYPE_MAPS[settings.kind]]
    if settings.country is not None:
        maps.append(str(_limits(settings.country, target.with_name("limits.typ.xml"))))
    return [
        *(_INPUT[settings.kind], str(settings.source)),
        *(["--type-files", ",".join(maps)] if maps else []),
        *("-o", str(target)),
        *_OPTIONS[settings.kind],
        *_GUESSES,
        *([_GUESS_CROSSINGS] if settings.crossings else []),
        *(["--tls.guess"] if settings.lights else []),
        *([DROP_SIMPLE_LIGHTS] if settings.drop_lights and settings.kind == "xodr" else []),
        *(["--lefthand"] if settings.left_hand else []),
    ]


def _limits(country: Country, file: Path) -> Path:
    """Writes a type map with a country's speed limits."""
    limits = dict.fromkeys(_IN_TOWN, float(country.town_kmh))
    limits |= {"motorway": country.motorway_kmh, "motorway_link": min(LINK_KMH, country.motorway_kmh)}
    rows = (f'<type id="highway.{kind}" speed="{kmh / KMH_PER_MPS:.2f}"/>' for kind, kmh in limits.items())
    file.write_text(f"<types>{''.join(rows)}</types>", encoding="utf-8")
    return file


def _has_roads(net: Path) -> bool:
    return any(element.tag == "lane" for _, element in ElementTree.iterparse(net))


def _longest_cycle(net: Path) -> float:
    """Longest cycle of a net's traffic lights, s."""
    cycles, cycle = [0.0], 0.0
    for _, element in ElementTree.iterparse(net):
        if element.tag == "phase":
            cycle += float(element.get("duration", 0.0))
        elif element.tag == "tlLogic":
            cycles.append(cycle)
            cycle = 0.0
        element.clear()
    return max(cycles)
