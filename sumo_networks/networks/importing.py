"""Import: roads from SUMO, OpenStreetMap and OpenDRIVE files become networks of the user's catalog, by netconvert.

Files are untrusted: `xml_guard.scan` checks each file before netconvert or another parser reads it.
"""

from __future__ import annotations

import gzip
import json
import os
import re
import shutil
import subprocess
import tempfile
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import sumo

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.entries import (
    ENTRY,
    NetworkSize,
    builtin_names,
    check_name,
    network_names,
    user_catalog,
)
from dohyo.sumo_networks.networks.inspection import NetworkReport, inspect_network, network_size
from dohyo.sumo_networks.networks.network import RoadNetwork, read_network
from dohyo.sumo_networks.networks.parsing import file_hash
from dohyo.sumo_networks.networks.xml_guard import LIMIT_MB, Census, scan

Kind = Literal["net", "osm", "xodr"]

TIMEOUT_S = 600.0
ROOTS: dict[Kind, str] = {"net": "net", "osm": "osm", "xodr": "OpenDRIVE"}
SUFFIXES: dict[str, Kind] = {".net.xml": "net", ".osm": "osm", ".osm.xml": "osm", ".xodr": "xodr"}
TITLES: dict[Kind, str] = {"net": "a SUMO net", "osm": "OpenStreetMap", "xodr": "OpenDRIVE"}
TYPE_MAPS: dict[Kind, tuple[str, ...]] = {
    "net": (),
    "osm": ("osmNetconvert", "osmNetconvertUrbanDe", "osmNetconvertPedestrians"),
    "xodr": ("opendriveNetconvert", "opendriveNetconvertPedestrians"),
}
OPTIONS: dict[Kind, tuple[str, ...]] = {
    "net": (),
    "osm": (
        *("--proj.utm", "--geometry.remove", "--roundabouts.guess", "--ramps.guess", "--junctions.join"),
        *("--tls.guess-signals", "--tls.discard-simple", "--tls.join", "--remove-edges.isolated"),
        *("--keep-edges.by-vclass", "passenger,bicycle,pedestrian"),
    ),
    "xodr": ("--opendrive.curve-resolution", "1", "--geometry.min-dist", "0.2"),
}
GUESSES = (
    *("--sidewalks.guess", "--crossings.guess", "--default.sidewalk-width", "2", "--default.crossing-width", "4"),
    *("--no-turnarounds.except-deadend", "--tls.default-type", "static"),
)


JOIN_LIGHTS = "--tls.join"
LONGEST_CYCLE_S = 150.0
"""A driver who waits at a red light for 180 s counts as blocked."""


@dataclass(frozen=True, slots=True)
class Imported:
    """A finished import.

    Attributes:
        folder: Folder of the new entry.
        report: The check of the new network.
    """

    folder: Path
    report: NetworkReport


def import_network(
    file: Path,
    name: str,
    *,
    lights: bool = False,
    force: bool = False,
    limit_mb: float = LIMIT_MB,
    licence: str | None = None,
    timeout_s: float = TIMEOUT_S,
) -> Imported:
    """Adds a network to the user's catalog from a file; if anything fails, nothing is written.

    Sidewalks and crossings are guessed if the file has none; a SUMO net with crossings is not changed.

    Args:
        file: A .net.xml, .osm, .osm.xml or .xodr file, also gzipped (.gz).
        name: Name of the new network.
        lights: Whether to guess traffic lights at large junctions too.
        force: Whether to replace a network of the user's catalog that has this name.
        limit_mb: Largest size of the file, packed or unpacked, MB.
        licence: Licence of the source's data; None: the usual one of its format.
        timeout_s: Time limit of netconvert, s.

    Raises:
        InvalidInputError: The name is invalid or taken, or the file gives no network that cars can drive on.
    """
    check_free(name, force)
    with tempfile.TemporaryDirectory(prefix="dohyo-import-") as work:
        guessed = prepare_network(
            file, name, Path(work), lights=lights, limit_mb=limit_mb, licence=licence, timeout_s=timeout_s
        )
        folder = publish_network(name, Path(work), force=force)
    return Imported(folder, inspect_network(load_network(name), guessed))


def prepare_network(
    file: Path,
    name: str,
    folder: Path,
    *,
    lights: bool = False,
    limit_mb: float = LIMIT_MB,
    licence: str | None = None,
    timeout_s: float = TIMEOUT_S,
) -> tuple[str, ...]:
    """Writes what the catalog will hold of a network to a folder; the arguments are those of `import_network`.

    Returns:
        Guesses and repairs, one line each.

    Raises:
        InvalidInputError: The file gives no network that cars can drive on.
    """
    kind = _kind(file)
    with tempfile.TemporaryDirectory(prefix="dohyo-import-") as work:
        plain, built = Path(work) / f"source.{kind}.xml", Path(work) / f"{name}.net.xml"
        before = scan(file, ROOTS[kind], limit_mb, copy=plain)
        if kind == "net" and not before.elements["lane"]:
            raise InvalidInputError(f"'{file}' has no lane open to passenger cars: it has no lane at all")
        as_it_is = kind == "net" and before.crossings > 0 and not lights
        warnings, decided = ([], []) if as_it_is else _convert(kind, plain, built, lights, file, timeout_s)
        packed = folder / net_name(name)
        packed.write_bytes(gzip.compress(without_comments((plain if as_it_is else built).read_bytes()), mtime=0))
    network = _checked(packed, name, file)
    guessed = (*decided, *_guessed(kind, before, network, warnings)) if not as_it_is else ()
    entry = _entry(file, kind, packed.name, licence, guessed, network_size(network))
    (folder / ENTRY).write_text(entry, encoding="utf-8")
    return guessed


def publish_network(name: str, prepared: Path, *, force: bool = False) -> Path:
    """Moves a prepared network into the user's catalog, all or nothing; returns the folder of its entry.

    Args:
        name: Name of the network.
        prepared: Folder that `prepare_network` has filled.
        force: Whether to replace a network of the user's catalog that has this name.

    Raises:
        InvalidInputError: The name is invalid or taken, or the catalog cannot be written.
    """
    check_free(name, force)
    files = (prepared / ENTRY, prepared / net_name(name))
    if not all(file.is_file() and not file.is_symlink() for file in files):
        raise InvalidInputError(
            f"network '{name}' is not complete: expected {' and '.join(file.name for file in files)}"
        )
    return _publish(name, files, force)


def retract_network(name: str) -> None:
    """Removes a network from the user's catalog, all or nothing.

    Raises:
        InvalidInputError: The name is invalid, or the catalog cannot be written.
    """
    check_name(name)
    folder = user_catalog() / name
    gone = folder.with_name(f".{name}.{os.getpid()}.gone")
    try:
        os.replace(folder, gone)
    except OSError as error:
        raise InvalidInputError(f"network '{name}' cannot be removed: {error.strerror}") from error
    shutil.rmtree(gone, ignore_errors=True)


def net_name(name: str) -> str:
    """File name of an imported network's roads."""
    return f"{name}.net.xml.gz"


def build_network(folder: Path, out: Path | None = None) -> Path:
    """Builds a network from the plain XML of its folder, by `FOLDER/NAME.netccfg`.

    Args:
        folder: Folder with the name of the network.
        out: Path of the net to write; None: `FOLDER/NAME.net.xml`.

    Raises:
        InvalidInputError: The folder does not exist, or netconvert rejects its content.
    """
    config = folder / f"{folder.resolve().name}.netccfg"
    if not config.is_file():
        raise InvalidInputError(f"'{folder}': expected netconvert's configuration '{config.name}' in it")
    out = out or config.with_suffix(".net.xml")
    with tempfile.TemporaryDirectory(prefix="dohyo-build-") as work:
        built = Path(work) / "built.net.xml"
        run_netconvert(["-c", str(config.resolve()), "-o", str(built)], config, TIMEOUT_S)
        out.write_bytes(without_comments(built.read_bytes()))
    return out


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
        done = _run("netconvert", [*arguments, *always], timeout_s)
    except subprocess.TimeoutExpired as error:
        raise InvalidInputError(f"'{file}': netconvert did not finish within {timeout_s:.0f} s") from error
    lines = [line for line in (done.stderr + done.stdout).splitlines() if line]
    if done.returncode:
        errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error: ")]
        why = errors[0] if errors else f"it ended with {done.returncode}"
        raise InvalidInputError(f"'{file}': netconvert cannot use the file: {why}")
    return [line.removeprefix("Warning: ") for line in lines if line.startswith("Warning: ")]


def without_comments(net: bytes) -> bytes:
    """Removes netconvert's comment (date and paths) from a net, so that the same source gives the same bytes."""
    return re.sub(rb"\n*<!-- generated on .*?-->\n*", b"\n\n", net, count=1, flags=re.DOTALL)


def _kind(file: Path) -> Kind:
    name = file.name.lower().removesuffix(".gz")
    for suffix, kind in SUFFIXES.items():
        if name.endswith(suffix):
            return kind
    raise InvalidInputError(f"'{file}': expected a file that ends in {', '.join(SUFFIXES)} (each also with .gz)")


def check_free(name: str, force: bool) -> None:
    """Checks that a network of this name may be added.

    Raises:
        InvalidInputError: The name is invalid or taken.
    """
    check_name(name)
    if name in builtin_names():
        raise InvalidInputError(f"network '{name}' comes with dohyo; choose another name")
    if name in network_names() and not force:
        raise InvalidInputError(f"network '{name}' exists; replace it with --force")


def _convert(
    kind: Kind, source: Path, target: Path, lights: bool, file: Path, timeout_s: float
) -> tuple[list[str], list[str]]:
    """Runs netconvert; joins the lights of neighbouring junctions only if that makes no endless cycle.

    Returns:
        netconvert's warnings, and what was decided, one line each.
    """
    maps = [str(Path(sumo.SUMO_HOME) / "data" / "typemap" / f"{name}.typ.xml") for name in TYPE_MAPS[kind]]
    options = {"net": "-s", "osm": "--osm-files", "xodr": "--opendrive-files"}
    arguments = [options[kind], str(source), *(["--type-files", ",".join(maps)] if maps else []), "-o", str(target)]
    arguments += [*OPTIONS[kind], *GUESSES, *(["--tls.guess"] if lights else [])]
    warnings = run_netconvert(arguments, file, timeout_s)
    if JOIN_LIGHTS not in arguments or (cycle := _longest_cycle(target)) <= LONGEST_CYCLE_S:
        return warnings, []
    arguments.remove(JOIN_LIGHTS)
    decided = f"lights of neighbouring junctions are not joined, since one would have a cycle of {cycle:.0f} s"
    return run_netconvert(arguments, file, timeout_s), [decided]


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


def _checked(net: Path, name: str, file: Path) -> RoadNetwork:
    """Reads the net, and checks that dohyo and SUMO can both open it."""
    try:
        network = read_network(net, name)
    except InvalidInputError as error:
        raise InvalidInputError(str(error).replace(str(net), str(file))) from error
    lanes, connections = network.lanes, network.connections
    drives = lanes.drivable[connections.source] & lanes.drivable[connections.target]
    if not (drives & ~lanes.internal[connections.source]).any():
        raise InvalidInputError(f"'{file}': no road leads to another for passenger cars, so there is nothing to drive")
    done = _run("sumo", ["-n", str(net), "--end", "1", "--no-step-log", "--xml-validation.net", "never"], 120.0)
    if done.returncode:
        raise InvalidInputError(f"'{file}': SUMO cannot open its net: {(done.stderr.splitlines() or [''])[0]}")
    return network


def _run(program: str, arguments: Sequence[str], timeout_s: float) -> subprocess.CompletedProcess[str]:
    home = Path(sumo.SUMO_HOME)
    environment = {**os.environ, "SUMO_HOME": str(home), "PROJ_LIB": str(home / "data" / "proj")}
    command = [str(home / "bin" / program), *arguments]
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, errors="replace", timeout=timeout_s, check=False
    )


def _guessed(kind: Kind, before: Census, network: RoadNetwork, warnings: Sequence[str]) -> tuple[str, ...]:
    lanes = network.lanes
    sidewalks = lanes.pedestrian & ~lanes.drivable & ~lanes.bicycle & ~lanes.crossing
    sidewalks &= [not str(lane).startswith(":") for lane in lanes.ids]
    counts = (
        ("sidewalks", int(sidewalks.sum()) - before.sidewalks),
        ("crossings", int(lanes.crossing.sum()) - before.crossings),
        ("traffic lights", len(network.signals.light_ids) - before.lights),
    )
    lines = [f"{count} {what} {'added' if kind == 'net' else 'read or guessed'}" for what, count in counts if count > 0]
    kinds = Counter(re.sub(r"'[^']*'|-?\d+(\.\d+)?", "…", warning) for warning in warnings)
    return (*lines, *(f"netconvert, {count} x: {text}" for text, count in kinds.most_common(12)))


def _entry(file: Path, kind: Kind, net: str, licence: str | None, guessed: Sequence[str], size: NetworkSize) -> str:
    usual = "ODbL (OpenStreetMap data)" if kind == "osm" else "as the source's; its file does not say"
    fields: dict[str, str | list[str]] = {
        "title": f"{file.name}, imported from {TITLES[kind]}",
        "source": file.name,
        "source_sha256": file_hash(file),
        "licence": licence or usual,
        "built": "by dohyo networks import",
        "file": net,
        "guessed": list(guessed),
    }
    counts = {"size." + key: value for key, value in size.model_dump().items()}
    # A JSON string, escaped to ASCII, is a TOML string too.
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in (fields | counts).items()).replace("\x7f", " ")


def _publish(name: str, files: Sequence[Path], force: bool) -> Path:
    """Moves files into the catalog as one folder, all or nothing."""
    catalog = user_catalog()
    catalog.mkdir(parents=True, exist_ok=True)
    staging = Path(tempfile.mkdtemp(prefix=".import-", dir=catalog))
    try:
        staging.chmod(0o755)
        for file in files:
            shutil.copyfile(file, staging / file.name)
        if force and (catalog / name).exists():
            os.replace(catalog / name, staging.with_name(staging.name + "-old"))
        os.rename(staging, catalog / name)
    except OSError as error:
        raise InvalidInputError(f"cannot write '{catalog / name}': {error.strerror}") from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        shutil.rmtree(staging.with_name(staging.name + "-old"), ignore_errors=True)
    return catalog / name
