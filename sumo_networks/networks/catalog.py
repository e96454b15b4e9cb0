"""The catalog: networks loaded by name or path, and kept in memory."""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from pathlib import Path

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.entries import builtin_names, network_path
from dohyo.sumo_networks.networks.network import RoadNetwork, read_network
from dohyo.sumo_networks.networks.xml_guard import LIMIT_MB


def load_network(name: str) -> RoadNetwork:
    """A network by its catalog name, or from a .net.xml[.gz] file; kept in memory until its file changes.

    Raises:
        InvalidInputError: Unknown name, or a file that is missing, harmful, larger than 200 MB (packed or unpacked), or
            no SUMO net with roads for cars. A network of the catalog may be larger: its import allowed it.
    """
    path = network_path(name)
    raw = path == Path(name)
    label = path.name.removesuffix(".gz").removesuffix(".net.xml") if raw else name
    try:
        state = path.stat()
    except OSError as error:
        raise InvalidInputError(f"cannot read network file '{path}': {error.strerror}") from error
    return _load(path, label, LIMIT_MB if raw else math.inf, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=8)
def _load(path: Path, label: str, limit_mb: float, _mtime_ns: int, _size: int) -> RoadNetwork:
    return read_network(path, label, limit_mb)


def parse_all() -> None:
    """Parses the networks that come with dohyo, so that the first use of each finds it in the cache."""
    with ProcessPoolExecutor() as pool:
        list(pool.map(_parse, builtin_names()))


def _parse(name: str) -> None:
    load_network(name)


if __name__ == "__main__":
    parse_all()
