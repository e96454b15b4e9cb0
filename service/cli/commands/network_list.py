"""`dohyo networks list`, from catalog entries alone."""

from __future__ import annotations

from typing import Any

from dohyo.service.cli.output import Json, print_listing
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.entries import (
    NetworkSize,
    builtin_names,
    network_entry,
    network_names,
    network_path,
)


def list_networks(json: Json = False) -> None:
    """Lists the networks of dohyo and those you imported."""
    print_listing([_network(name) for name in network_names()], json)


def _network(name: str) -> dict[str, Any]:
    row: dict[str, Any] = dict.fromkeys(("name", "lanes", "lane_km", "lights", "crossings", "title", "licence", "from"))
    row |= {"name": name, "from": "dohyo" if name in builtin_names() else "you"}
    try:
        entry, size = network_entry(name), _size(name)
    except InvalidInputError as error:
        if row["from"] == "dohyo":
            raise
        # One broken import must not hide the other networks.
        return row | {"title": f"broken: {error}"}
    return row | size.model_dump() | {"title": entry.title, "licence": entry.licence}


def _size(name: str) -> NetworkSize:
    """Size from the catalog entry; imports by an earlier version have none, so their net is read."""
    path, size = network_path(name), network_entry(name).size
    if not path.is_file() or path.stat().st_size == 0:
        raise InvalidInputError(f"'{path}': expected a SUMO net, got {'an empty' if path.is_file() else 'no'} file")
    if size is not None:
        return size
    from dohyo.sumo_networks.networks.catalog import load_network
    from dohyo.sumo_networks.networks.inspection import network_size

    return network_size(load_network(name))
