"""Entries of the catalogs by name: networks that come with dohyo, and the user's imports. Reads no network."""

from __future__ import annotations

import os
import re
from functools import lru_cache
from pathlib import Path

import sumo

from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

CATALOG = Path(__file__).parents[1] / "catalog"
ENTRY = "network.toml"
NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,62}")


class NetworkSize(Config):
    """Size of a network; `inspection.network_size` measures it.

    Attributes:
        lanes: Number of lanes open to cars, outside junctions.
        lane_km: Total length of these lanes, km.
        lights: Number of traffic lights.
        crossings: Number of pedestrian crossings.
    """

    lanes: int
    lane_km: float
    lights: int
    crossings: int


class NetworkEntry(Config):
    """Content of `catalog/NAME/network.toml`.

    Attributes:
        title: Description in one line.
        source: Origin of the net.
        source_sha256: Hash of the imported file's bytes; None: not an import, or an old one.
        licence: Licence of the net and its data.
        built: Command that made the net from its source; None if the source is a net.
        sumo_file: Path inside the eclipse-sumo package, for the nets that it contains.
        file: Path inside the entry's own folder, for all others.
        guessed: Guesses and repairs of the import, one line each.
        mirrored: Whether the net is the mirror image of a place with left-hand traffic.
        size: Size of the network, so that lists need not read the net; None: unknown (old imports).
    """

    title: str
    source: str
    licence: str
    source_sha256: str | None = None
    built: str | None = None
    sumo_file: str | None = None
    file: str | None = None
    guessed: tuple[str, ...] = ()
    mirrored: bool = False
    size: NetworkSize | None = None


def user_folder() -> Path:
    """Folder of the user's own data: $DOHYO_HOME, else `dohyo` in the system's folder for user data."""
    home = os.environ.get("DOHYO_HOME")
    if home:
        return Path(home)
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "dohyo"


def user_catalog() -> Path:
    """Folder of imported networks."""
    return user_folder() / "networks"


def check_name(name: str) -> None:
    """Checks that a name can be a folder of the catalog.

    Raises:
        InvalidInputError: The name cannot be a folder, or would lie outside the catalog.
    """
    if not NAME.fullmatch(name):
        raise InvalidInputError(
            f"network name '{name}': expected 1 to 63 small letters, digits and hyphens, without a hyphen at the start"
        )


def builtin_names() -> list[str]:
    """Names of the networks that come with dohyo, sorted."""
    return _names(CATALOG)


def network_names() -> list[str]:
    """Names of all networks, those of the user's catalog included, sorted."""
    return sorted({*builtin_names(), *_names(user_catalog())})


def network_folder(name: str) -> Path:
    """Folder of a network's entry; the networks that come with dohyo take precedence over the user's.

    Raises:
        UnknownNameError: Neither catalog has such a name.
    """
    if NAME.fullmatch(name):
        if (CATALOG / name / ENTRY).exists():
            return CATALOG / name
        if (user_catalog() / name / ENTRY).exists():
            return user_catalog() / name
    raise UnknownNameError("network", name, network_names())


def network_entry(name: str) -> NetworkEntry:
    """The catalog's entry of a network.

    Raises:
        UnknownNameError: The catalog has no such name.
        InvalidInputError: Its network.toml is broken.
    """
    return _entry_in(network_folder(name))


def is_mirrored(name: str) -> bool:
    """Whether a network of the catalog is the mirror image of its place; see `conversion.mirroring`."""
    return name in network_names() and network_entry(name).mirrored


def network_path(name: str) -> Path:
    """Path of a network's SUMO net, by catalog name or by the path of a .net.xml[.gz] file.

    Raises:
        UnknownNameError: The name is neither in a catalog nor the path of a net file.
        InvalidInputError: It is no text.
    """
    if not isinstance(name, str):
        raise InvalidInputError(f"expected the name of a network, or the path of its file as text, got {name!r}")
    if name.endswith((".net.xml", ".net.xml.gz")):
        return Path(name)
    folder = network_folder(name)
    entry = _entry_in(folder)
    if entry.sumo_file:
        return Path(sumo.SUMO_HOME) / entry.sumo_file
    return folder / (entry.file or f"{name}.net.xml")


def _entry_in(folder: Path) -> NetworkEntry:
    path = folder / ENTRY
    state = path.stat()
    return _read_entry(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=64)  # a scenario is drawn from hundreds of attempts, and each loads its network by name
def _read_entry(path: Path, _mtime_ns: int, _size: int) -> NetworkEntry:
    return NetworkEntry.read_toml(path)


def _names(catalog: Path) -> list[str]:
    return sorted(entry.parent.name for entry in catalog.glob(f"*/{ENTRY}") if NAME.fullmatch(entry.parent.name))
