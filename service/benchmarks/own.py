"""Benchmarks of the organiser's own: files of `dohyo benchmarks create` in the folder `benchmarks` of the data folder.

They are read anew at each question, so that a file may be added, or changed to a new version, while the service runs.
"""

from __future__ import annotations

import logging
from pathlib import Path

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.benchmarks.documents import benchmark_names
from dohyo.evaluation.families import Family
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.networks.entries import network_names, user_folder

logger = logging.getLogger("dohyo.service")


def own_names() -> list[str]:
    """Sorted names of the files; one that has the name of a shipped benchmark is none of them."""
    shipped = {name for family in Family for name in benchmark_names(family)}
    return sorted({path.stem for path in _folder().glob("*.toml")} - shipped)


def load_own(name: str) -> Benchmark:
    """The benchmark of a file.

    Args:
        name: Name of the benchmark and of its file, one of `own_names`.

    Raises:
        InvalidInputError: It cannot be read, has another name, or a network that this service does not have. Clients
            see the message, which does not tell the folder.
    """
    path = _folder() / f"{name}.toml"
    try:
        benchmark = load_benchmark(str(path))
    except InvalidInputError as error:
        raise InvalidInputError(str(error).replace(str(path), path.name)) from error
    if benchmark.name != name:
        raise InvalidInputError(f"benchmark file '{path.name}': name: expected '{name}', got '{benchmark.name}'")
    for network in benchmark.networks:
        if network not in network_names():  # a path would be a file that confined processes cannot read
            raise InvalidInputError(f"benchmark file '{path.name}': this service has no network '{network}'")
    return benchmark


def own_benchmarks() -> list[Benchmark]:
    """All that can be read; the log names the others."""
    found = []
    for name in own_names():
        try:
            found.append(load_own(name))
        except InvalidInputError as error:
            logger.warning("left out: %s", error)
    return found


def own_file(name: str) -> bytes:
    """The file of a benchmark.

    Raises:
        UnknownNameError: There is none.
    """
    try:
        if name in own_names():
            return (_folder() / f"{name}.toml").read_bytes()
    except OSError:
        pass  # removed since, or no file
    raise UnknownNameError("benchmark of this service's own", name, own_names())


def _folder() -> Path:
    return user_folder() / "benchmarks"
