"""What the catalogs hold by name: networks that come with dohyo, and those the user imported. Reads no network."""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path

import sumo
from pydantic import ValidationError

from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

CATALOG = Path(__file__).parents[1] / "catalog"
ENTRY = "network.toml"
NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,62}")


class NetworkSize(Config):
    """How much a network holds; `inspection.network_size` measures it.

    Attributes:
        lanes: Open to cars, outside junctions.
        lane_km: Their length.
        lights: Traffic lights.
        crossings: Pedestrian crossings.
    """

    lanes: int
    lane_km: float
    lights: int
    crossings: int


class NetworkEntry(Config):
    """What `catalog/NAME/network.toml` says.

    Attributes:
        title: One line for people.
        source: Where the net comes from.
        licence: Under which terms.
        built: How the net was made from its source, where it was.
        sumo_file: Path inside the eclipse-sumo package, for nets it ships.
        file: Path inside the entry's own folder, for all others.
        guessed: What the import guessed or repaired, one line each.
        size: So that a list need not read the net; None: unknown, as in imports by earlier versions.
    """

    title: str
    source: str
    licence: str
    built: str | None = None
    sumo_file: str | None = None
    file: str | None = None
    guessed: tuple[str, ...] = ()
    size: NetworkSize | None = None


def user_catalog() -> Path:
    """Where imported networks live: $DOHYO_HOME/networks, else in the user's data folder."""
    home = os.environ.get("DOHYO_HOME")
    if home:
        return Path(home) / "networks"
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "dohyo" / "networks"


def check_name(name: str) -> None:
    """Refuses names that could not be a folder of the catalog, or leave it.

    Raises:
        InvalidInputError: The name is no such name.
    """
    if not NAME.fullmatch(name):
        raise InvalidInputError(
            f"network name '{name}': expected 1 to 63 small letters, digits and hyphens, the first no hyphen"
        )


def builtin_names() -> list[str]:
    """Names of the networks that come with dohyo, sorted."""
    return _names(CATALOG)


def network_names() -> list[str]:
    """Names of all networks, those of the user's catalog included, sorted."""
    return sorted({*builtin_names(), *_names(user_catalog())})


def network_folder(name: str) -> Path:
    """The folder of a network's entry; where both catalogs have the name, the one that comes with dohyo.

    Raises:
        UnknownNameError: Neither catalog has such a name.
    """
    for catalog in (CATALOG, user_catalog()):
        if name in _names(catalog):
            return catalog / name
    raise UnknownNameError("network", name, network_names())


def network_entry(name: str) -> NetworkEntry:
    """The catalog's entry of a network.

    Raises:
        UnknownNameError: The catalog has no such name.
        InvalidInputError: Its network.toml is broken.
    """
    path = network_folder(name) / ENTRY
    try:
        return NetworkEntry.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (ValidationError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"{path}: {error}") from error


def network_path(name: str) -> Path:
    """Path of a network's SUMO net: of a catalog name, or of a .net.xml[.gz] file itself.

    Raises:
        UnknownNameError: Neither a catalog name nor a path of a net file.
    """
    if name.endswith((".net.xml", ".net.xml.gz")):
        return Path(name)
    entry = network_entry(name)
    if entry.sumo_file:
        return Path(sumo.SUMO_HOME) / entry.sumo_file
    return network_folder(name) / (entry.file or f"{name}.net.xml")


def _names(catalog: Path) -> list[str]:
    return sorted(entry.parent.name for entry in catalog.glob(f"*/{ENTRY}") if NAME.fullmatch(entry.parent.name))
