"""Networks of the catalog by name: found, checked to be free, described."""

from __future__ import annotations

from functools import lru_cache

from dohyo.service.errors import ConflictError, TooManyRequestsError
from dohyo.service.networks.views import NetworkView
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.entries import builtin_names, check_name, network_entry, network_names, network_path
from dohyo.sumo_networks.networks.inspection import network_size
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.networks.projection import read_offset

UPLOADED = 100


def find_network(name: str) -> RoadNetwork:
    """A network of the catalog by its name; a name is never used as a path.

    Raises:
        UnknownNameError: There is none.
    """
    check_known(name)
    return load_network(name)


def check_known(name: str) -> None:
    """Checks that the catalog has a network of this name, and reads none.

    Raises:
        UnknownNameError: There is none.
    """
    if name not in network_names():
        raise UnknownNameError("network", name, network_names())


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


def view_network(name: str) -> NetworkView:
    """View of a network of the catalog; its roads are loaded only where their file is new.

    Raises:
        UnknownNameError: There is none.
        InvalidInputError: Its files cannot be read.
    """
    check_known(name)
    try:
        state = network_path(name).stat()
    except OSError as error:
        raise InvalidInputError(f"network '{name}' cannot be read: {error.strerror}") from error
    return _viewed(name, state.st_ino, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=2 * UPLOADED)  # of networks, few are in memory at once
def _viewed(name: str, _inode: int, _mtime_ns: int, _size: int) -> NetworkView:
    network, entry = load_network(name), network_entry(name)
    return NetworkView(
        name=name,
        title=entry.title,
        licence=entry.licence,
        source=entry.source,
        origin="dohyo" if name in builtin_names() else "upload",
        sha256=network.sha256,
        mirrored=entry.mirrored,
        guessed=list(entry.guessed),
        **network_size(network).model_dump(),
        bounds=[round(value, 2) for value in network.bounds],
        net_offset=[*(read_offset(network.path) or (0.0, 0.0))],
    )
