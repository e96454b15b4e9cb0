"""Import: roads from SUMO, OpenStreetMap and OpenDRIVE files become networks of the user's catalog, by netconvert.

Files are untrusted: `xml_guard.scan` checks each file before netconvert or another parser reads it.
"""

from __future__ import annotations

import gzip
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from dohyo.sumo_networks.config import toml_value
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.conversion.netconvert import (
    TIMEOUT_S,
    run_netconvert,
    run_program,
    without_comments,
)
from dohyo.sumo_networks.networks.conversion.repair import plan_repair
from dohyo.sumo_networks.networks.conversion.source_file import USUAL_OPTIONS, ImportOptions, SourceFile, read_source
from dohyo.sumo_networks.networks.conversion.sources import TITLES
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

Progress = Callable[[str], None]
"""Called with the name of each step when it begins."""


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
    options: ImportOptions = USUAL_OPTIONS,
    *,
    force: bool = False,
    progress: Progress = lambda step: None,
) -> Imported:
    """Adds a network to the user's catalog from a file; if anything fails, nothing is written.

    Sidewalks and crossings are guessed if the file has none; a SUMO net with crossings is not changed. Left-hand
    traffic becomes its mirror image, see `conversion.mirroring`.

    Args:
        file: A .net.xml, .osm, .osm.xml or .xodr file, also packed (.gz, .bz2), or a .pbf file.
        name: Name of the new network.
        options: Choices.
        force: Whether to replace a network of the user's catalog that has this name.
        progress: Called with the name of each step when it begins.

    Raises:
        InvalidInputError: The name is invalid or taken, or the file gives no network that cars can drive on.
    """
    check_free(name, force)
    with tempfile.TemporaryDirectory(prefix="dohyo-import-") as work:
        guessed = prepare_network(file, name, Path(work), options, progress)
        folder = publish_network(name, Path(work), force=force)
    progress("checking the network")
    return Imported(folder, inspect_network(load_network(name), guessed))


def prepare_network(
    file: Path,
    name: str,
    folder: Path,
    options: ImportOptions,
    progress: Progress = lambda step: None,
) -> tuple[str, ...]:
    """Writes what the catalog will hold of a network to a folder; the arguments are those of `import_network`.

    Returns:
        Guesses and repairs, one line each.

    Raises:
        InvalidInputError: The file gives no network that cars can drive on.
    """
    packed = folder / net_name(name)
    with tempfile.TemporaryDirectory(prefix="dohyo-import-") as work:
        progress("reading the file")
        source = read_source(file, Path(work) / "source.xml", options)
        progress("converting it")
        made = source.convert(Path(work) / f"{name}.net.xml")
        _pack(made.path, packed)
        progress("trying the roads")
        network = _checked(packed, name, file, made.warnings is not None, options.timeout_s)
        repair = plan_repair(network, largest=options.largest_part, fix=options.fix)
        if repair.needed:
            progress("repairing it")
            _pack(repair.carry_out(made.path, Path(work) / "repaired.net.xml", file, options.timeout_s), packed)
            network = _checked(packed, name, file, True, options.timeout_s)
    guessed = (*made.decided, *repair.decided, *source.counted(network, made.warnings))
    entry = _entry(source, packed.name, guessed, network_size(network))
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
        OSError: The net cannot be written; what was there stays.
    """
    config = folder / f"{folder.resolve().name}.netccfg"
    if not config.is_file():
        raise InvalidInputError(f"'{folder}': expected netconvert's configuration '{config.name}' in it")
    out = out or config.with_suffix(".net.xml")
    with tempfile.TemporaryDirectory(prefix="dohyo-build-") as work:
        built = Path(work) / "built.net.xml"
        run_netconvert(["-c", str(config.resolve()), "-o", str(built)], config, TIMEOUT_S)
        write_atomically(out, without_comments(built.read_bytes()))
    return out


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


def _pack(net: Path, packed: Path) -> None:
    packed.write_bytes(gzip.compress(without_comments(net.read_bytes()), mtime=0))


def _checked(net: Path, name: str, file: Path, converted: bool, timeout_s: float) -> RoadNetwork:
    """Reads the net, and checks that dohyo and SUMO can both open it.

    Args:
        net: The net.
        name: Name of the new network.
        file: Path that the user gave, for error messages.
        converted: Whether netconvert has made the net; otherwise it is the file as it is.
        timeout_s: Time that SUMO has to open it, s.
    """
    try:
        network = read_network(net, name)
    except InvalidInputError as error:
        raise InvalidInputError(str(error).replace(str(net), str(file))) from error
    lanes, connections = network.lanes, network.connections
    drives = lanes.drivable[connections.source] & lanes.drivable[connections.target]
    if not (drives & ~lanes.internal[connections.source]).any():
        raise InvalidInputError(f"'{file}': no road leads to another for passenger cars, so there is nothing to drive")
    command = ["-n", str(net), "--end", "1", "--no-step-log", "--xml-validation.net", "never"]
    try:
        done = run_program("sumo", command, timeout_s)
    except subprocess.TimeoutExpired as error:
        raise InvalidInputError(f"'{file}': SUMO did not open the net within {timeout_s:.0f} s") from error
    if done.returncode:
        errors = [line.removeprefix("Error: ") for line in done.stderr.splitlines() if line.startswith("Error: ")]
        what = "the net that netconvert made of it" if converted else "it"
        why = errors[0] if errors else f"it ended with {done.returncode}"
        raise InvalidInputError(f"'{file}': SUMO cannot open {what}: {why}")
    return network


def _entry(source: SourceFile, net: str, guessed: Sequence[str], size: NetworkSize) -> str:
    """Text of the catalog's entry."""
    usual = "ODbL (OpenStreetMap data)" if source.kind == "osm" else "as the source's; its file does not say"
    fields: dict[str, str | list[str] | bool | int | float] = {
        "title": f"{source.file.name}, imported from {TITLES[source.kind]}",
        "source": source.file.name,
        "source_sha256": file_hash(source.file),
        "licence": source.options.licence or usual,
        "built": "by dohyo networks import",
        "file": net,
        "guessed": list(guessed),
        "mirrored": source.left_hand or source.options.mirrored,
    }
    fields |= {"size." + key: value for key, value in size.model_dump().items()}
    return "".join(f"{key} = {toml_value(value)}\n" for key, value in fields.items())


def _publish(name: str, files: Sequence[Path], force: bool) -> Path:
    """Moves files into the catalog as one folder, all or nothing."""
    entry = user_catalog() / name
    try:
        entry.parent.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=".import-", dir=entry.parent))
        old = staging.with_name(staging.name + "-old")
        try:
            staging.chmod(0o755)
            for file in files:
                shutil.copyfile(file, staging / file.name)
            if force and entry.exists():
                os.replace(entry, old)
            os.rename(staging, entry)
        finally:
            if old.exists() and not entry.exists():  # interrupted between the two
                os.rename(old, entry)
            shutil.rmtree(staging, ignore_errors=True)
            shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        raise InvalidInputError(f"cannot write '{entry}': {error.strerror}") from error
    return entry
