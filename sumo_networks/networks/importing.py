"""Import: roads from SUMO, OpenStreetMap and OpenDRIVE files become networks of the user's catalog, by netconvert.

Files are untrusted: `xml_guard.scan` checks each file before netconvert or another parser reads it.
"""

from __future__ import annotations

import gzip
import json
import os
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.conversion.countries import (
    Country,
    country_at,
    country_named,
    unknown_country,
)
from dohyo.sumo_networks.networks.conversion.mirroring import mirror_image
from dohyo.sumo_networks.networks.conversion.netconvert import (
    TIMEOUT_S,
    Conversion,
    convert,
    run_netconvert,
    run_program,
    without_comments,
)
from dohyo.sumo_networks.networks.conversion.repair import plan_repair
from dohyo.sumo_networks.networks.conversion.sources import TITLES, Kind, kind_of, unpack
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
from dohyo.sumo_networks.networks.xml_guard import LIMIT_MB


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """Choices of an import.

    Attributes:
        lights: Whether to guess traffic lights at large junctions too.
        left_hand: Whether traffic drives on the left; None: as in the country of an OSM extract, or as the file says.
        country: Two letters of the country whose rules hold in an OSM extract; None: that of the nearest town.
        largest_part: Whether to remove the roads that do not lead to and from the largest connected part.
        fix: Whether to mend lights without a purpose, lights with endless phases, and implausible speed limits.
        limit_mb: Largest size of the file, packed or unpacked, MB.
        licence: Licence of the source's data; None: the usual one of its format.
        timeout_s: Time limit of netconvert, s.
    """

    lights: bool = False
    left_hand: bool | None = None
    country: str | None = None
    largest_part: bool = False
    fix: bool = False
    limit_mb: float = LIMIT_MB
    licence: str | None = None
    timeout_s: float = TIMEOUT_S


MIRRORED = (
    "left-hand traffic: this network is the mirror image of the place, in which traffic drives on the right; east and "
    "west, and left and right turns, change places"
)
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
    options: ImportOptions = ImportOptions(),
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
    options: ImportOptions = ImportOptions(),
    progress: Progress = lambda step: None,
) -> tuple[str, ...]:
    """Writes what the catalog will hold of a network to a folder; the arguments are those of `import_network`.

    Returns:
        Guesses and repairs, one line each.

    Raises:
        InvalidInputError: The file gives no network that cars can drive on.
    """
    kind = kind_of(file)
    packed = folder / net_name(name)
    with tempfile.TemporaryDirectory(prefix="dohyo-import-") as work:
        source = _Source(file, kind, Path(work) / f"source.{kind}.xml", options)
        progress("reading the file")
        source.read()
        progress("converting it")
        made = source.convert(Path(work) / f"{name}.net.xml")
        _pack(made.net, packed)
        progress("trying the roads")
        network = _checked(packed, name, file)
        repair = plan_repair(network, largest=options.largest_part, fix=options.fix)
        if repair.needed:
            progress("repairing it")
            _pack(repair.carry_out(made.net, Path(work) / "repaired.net.xml", file, options.timeout_s), packed)
            network = _checked(packed, name, file)
    guessed = (*made.decided, *repair.decided, *source.counted(network, made.warnings))
    entry = _entry(file, kind, packed.name, options.licence, guessed, network_size(network), made.mirrored)
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


@dataclass(frozen=True, slots=True)
class _Made:
    """A converted net.

    Attributes:
        net: The net, with right-hand traffic.
        mirrored: Whether it is the mirror image of left-hand traffic.
        warnings: netconvert's warnings; None: the net is the file as it is.
        decided: Decisions, one line each.
    """

    net: Path
    mirrored: bool
    warnings: list[str] | None
    decided: list[str]


class _Source:
    """A file that is being imported."""

    def __init__(self, file: Path, kind: Kind, plain: Path, options: ImportOptions) -> None:
        self.file, self.kind, self.plain, self.options = file, kind, plain, options

    def read(self) -> None:
        """Checks the file, and unpacks it.

        Raises:
            InvalidInputError: The file cannot be imported.
        """
        self.census = unpack(self.file, self.options.limit_mb, self.plain)
        if self.kind == "net" and not self.census.elements["lane"]:
            raise InvalidInputError(f"'{self.file}' has no lane open to passenger cars: it has no lane at all")
        self.country = self._country()
        self.left_hand = self._left_hand()

    def convert(self, built: Path) -> _Made:
        """Makes the net."""
        decided = []
        if self.country is not None:
            decided.append(f"country {self.country.code}: {self.country.summary}")
        if self.left_hand:
            decided.append(MIRRORED)
        mirrored_first = self.left_hand and self.kind == "net"
        if mirrored_first:
            self.plain.write_bytes(mirror_image(self.plain.read_bytes()))
        if self.kind == "net" and self.census.crossings > 0 and not self.options.lights:
            return _Made(self.plain, self.left_hand, None, decided)
        settings = Conversion(
            kind=self.kind,
            source=self.plain,
            file=self.file,
            lights=self.options.lights,
            drop_lights=self.options.fix,
            left_hand=self.left_hand and not mirrored_first,
            country=self.country,
            timeout_s=self.options.timeout_s,
        )
        warnings, chosen = convert(settings, built)
        if settings.left_hand:
            built.write_bytes(mirror_image(built.read_bytes()))
        return _Made(built, self.left_hand, warnings, [*decided, *chosen])

    def counted(self, network: RoadNetwork, warnings: Sequence[str] | None) -> tuple[str, ...]:
        """Lines about what was guessed: numbers of objects, and netconvert's warnings."""
        if warnings is None:
            return ()
        before, lanes = self.census, network.lanes
        sidewalks = lanes.pedestrian & ~lanes.drivable & ~lanes.bicycle & ~lanes.crossing
        sidewalks &= [not str(lane).startswith(":") for lane in lanes.ids]
        counts = (
            ("sidewalks", int(sidewalks.sum()) - before.sidewalks),
            ("crossings", int(lanes.crossing.sum()) - before.crossings),
            ("traffic lights", len(network.signals.light_ids) - before.lights),
        )
        how = "added" if self.kind == "net" else "read or guessed"
        kinds = Counter(re.sub(r"'[^']*'|-?\d+(\.\d+)?", "…", warning) for warning in warnings)
        return (
            *(f"{count} {what} {how}" for what, count in counts if count > 0),
            *(f"netconvert, {count} x: {text}" for text, count in kinds.most_common(12)),
        )

    def _country(self) -> Country | None:
        """Country of an OSM extract; None for other kinds of files, whose roads have limits."""
        if self.kind != "osm":
            if self.options.country is not None:
                raise InvalidInputError(f"'{self.file}': a country can be given for OpenStreetMap files only")
            return None
        if self.options.country is not None:
            return country_named(self.options.country)
        return country_at(*self.census.place) if self.census.place else unknown_country()

    def _left_hand(self) -> bool:
        asked = self.options.left_hand
        if self.kind == "osm":
            return asked if asked is not None else self.country is not None and self.country.left_hand
        if self.kind == "xodr" and (asked or self.census.left_hand):
            raise InvalidInputError(
                f"'{self.file}': left-hand traffic cannot be imported from OpenDRIVE, which netconvert reads as "
                "right-hand traffic"
            )
        if asked is not None and asked != self.census.left_hand:
            raise InvalidInputError(
                f"'{self.file}': the net says that traffic drives on the {'left' if self.census.left_hand else 'right'}"
            )
        return self.census.left_hand


def _pack(net: Path, packed: Path) -> None:
    packed.write_bytes(gzip.compress(without_comments(net.read_bytes()), mtime=0))


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
    done = run_program("sumo", ["-n", str(net), "--end", "1", "--no-step-log", "--xml-validation.net", "never"], 120.0)
    if done.returncode:
        raise InvalidInputError(f"'{file}': SUMO cannot open its net: {(done.stderr.splitlines() or [''])[0]}")
    return network


def _entry(
    file: Path, kind: Kind, net: str, licence: str | None, guessed: Sequence[str], size: NetworkSize, mirrored: bool
) -> str:
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
    mirror = "mirrored = true\n" if mirrored else ""
    counts = {"size." + key: value for key, value in size.model_dump().items()}
    # A JSON string, escaped to ASCII, is a TOML string too.
    lines = (f"{key} = {json.dumps(value)}\n" for key, value in (fields | counts).items())
    return (mirror + "".join(lines)).replace("\x7f", " ")


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
