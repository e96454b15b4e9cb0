"""The catalog: networks known by name, one folder each under `catalog/`."""

from __future__ import annotations

import tomllib
from functools import lru_cache
from pathlib import Path

import sumo
from pydantic import ValidationError

from sumo_networks.errors import InvalidInputError, UnknownNameError
from sumo_networks.network import RoadNetwork, read_network
from sumo_networks.scenario import Config

CATALOG = Path(__file__).parent / "catalog"


class NetworkEntry(Config):
    """What `catalog/NAME/network.toml` says.

    Attributes:
        title: One line for people.
        source: Where the net comes from.
        licence: Under which terms.
        sumo_file: Path inside the eclipse-sumo package, for nets it ships.
        file: Path inside the entry's own folder, for nets of ours.
    """

    title: str
    source: str
    licence: str
    sumo_file: str | None = None
    file: str | None = None


def network_names() -> list[str]:
    """Names of the catalog, sorted."""
    return sorted(folder.parent.name for folder in CATALOG.glob("*/network.toml"))


def network_entry(name: str) -> NetworkEntry:
    """The catalog's entry of a network.

    Raises:
        UnknownNameError: The catalog has no such name.
        InvalidInputError: Its network.toml is broken.
    """
    if name not in network_names():
        raise UnknownNameError("network", name, network_names())
    path = CATALOG / name / "network.toml"
    try:
        return NetworkEntry.model_validate(tomllib.loads(path.read_text()))
    except (ValidationError, tomllib.TOMLDecodeError) as error:
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
    return CATALOG / name / (entry.file or f"{name}.net.xml")


@lru_cache(maxsize=8)
def load_network(name: str) -> RoadNetwork:
    """A network by its catalog name, or from a .net.xml[.gz] file.

    Raises:
        InvalidInputError: Unknown name, missing file, or a file that is no SUMO net with roads for cars.
    """
    path = network_path(name)
    return read_network(
        path, Path(path.name.removesuffix(".gz")).name.removesuffix(".net.xml") if path == Path(name) else name
    )
