"""Networks of the catalog by name: found, checked to be free, described."""

from __future__ import annotations

from functools import lru_cache

from dohyo.service.errors import ConflictError, TooManyRequestsError
from dohyo.service.networks.views import NetworkView
from dohyo.sumo_networks.errors import UnknownNameError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.entries import builtin_names, check_name, network_entry, network_names
from dohyo.sumo_networks.networks.inspection import network_size
from dohyo.sumo_networks.networks.network import RoadNetwork

UPLOADED = 100


def find_network(name: str) -> RoadNetwork:
    """A network of the catalog by its name; a name is never used as a path.

    Raises:
        UnknownNameError: There is none.
    """
    if name not in network_names():
        raise UnknownNameError("network", name, network_names())
    return load_network(name)


def check_free(name: str) -> None:
    """Checks that a network of this name may be added.

    Raises:
        InvalidInputError: The name is invalid.
        ConflictError: There is one.
        TooManyRequestsError: The catalog is full.
    """
    check_name(name)
    if name in network_names():
        raise ConflictError(f"network '{name}' exists, and networks never change; choose another name")
    if len(network_names()) - len(builtin_names()) >= UPLOADED:
        raise TooManyRequestsError(f"at most {UPLOADED} networks can be uploaded", retry_s=3600)


def view_network(network: RoadNetwork) -> NetworkView:
    """View of a network."""
    return _viewed(network.name, network.sha256)


@lru_cache(maxsize=2 * UPLOADED)
def _viewed(name: str, sha256: str) -> NetworkView:
    network, entry = load_network(name), network_entry(name)
    return NetworkView(
        name=name,
        title=entry.title,
        licence=entry.licence,
        source=entry.source,
        origin="dohyo" if name in builtin_names() else "upload",
        sha256=sha256,
        mirrored=entry.mirrored,
        guessed=list(entry.guessed),
        **network_size(network).model_dump(),
        bounds=[round(value, 2) for value in network.bounds],
    )
