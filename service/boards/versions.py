"""Versions of a benchmark that boards are of: those that were evaluated here, and the current one."""

from __future__ import annotations

from typing import Annotated

from fastapi import Query
from sqlalchemy.orm import Session

from dohyo.service.benchmarks.catalog import AnyBenchmark, find_benchmark
from dohyo.service.boards import queries as reading
from dohyo.service.episodes.readers import Readers
from dohyo.service.web.spelling import VERSION_HASH
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

VersionHash = Annotated[
    str | None, Query(pattern=VERSION_HASH, description="Content hash or its beginning; by default the newest.")
]


def find_version(session: Session, readers: Readers, name: str, version: str | None) -> tuple[AnyBenchmark, list[str]]:
    """A benchmark as it was evaluated here, or as it is now, and all versions that were evaluated, newest first.

    Args:
        session: To read in.
        readers: With the parsed benchmarks.
        name: Name of the benchmark.
        version: Content hash or its beginning; None: the newest one that was evaluated.

    Raises:
        InvalidInputError: Several versions begin like that.
        UnknownNameError: There is no such benchmark or version.
    """
    everything = reading.benchmark_versions(session, name)
    found = [one for one in everything if one.sha256.startswith(version or "")]
    if version and len(found) > 1:
        raise InvalidInputError(f"version '{version}' of benchmark '{name}' could be any of {len(found)}")
    benchmark = readers.stored(found[0]) if found else _unevaluated(name, version, reading.benchmark_names(session))
    return benchmark, [one.sha256 for one in everything]


def _unevaluated(name: str, version: str | None, evaluated: list[str]) -> AnyBenchmark:
    """A benchmark that has no evaluation yet.

    Raises:
        UnknownNameError: No benchmark has this name and version; file names are refused too.
    """
    if name.endswith(".toml"):
        raise UnknownNameError("benchmark", name, evaluated)
    benchmark = find_benchmark(name)
    if version and not benchmark.sha256.startswith(version):
        raise UnknownNameError(f"version of benchmark '{name}'", version, [benchmark.sha256])
    return benchmark
