"""Benchmarks: those that ship with dohyo and the organiser's own, and their versions that were evaluated here."""

from __future__ import annotations

from typing import Any, Final

from fastapi import APIRouter
from fastapi.responses import Response

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.families import Family
from dohyo.evaluation.freeway.benchmark import ForecastBenchmark
from dohyo.evaluation.freeway.day import DAY
from dohyo.evaluation.freeway.morning import MORNING
from dohyo.evaluation.parking.benchmark import LOT, ParkingBenchmark
from dohyo.service.accounts.access import Reader
from dohyo.service.benchmarks.catalog import AnyBenchmark, find_benchmark, offered_benchmarks
from dohyo.service.benchmarks.own import own_file
from dohyo.service.benchmarks.views import BenchmarkVersionView, BenchmarkView
from dohyo.service.evaluations.queries import count_by_version
from dohyo.service.state import ServicesOf
from dohyo.service.web.documents import Name, problems
from dohyo.service.web.heavy import heavy_read

TOML: Final = "application/toml"

router = APIRouter(prefix="/v1/benchmarks", tags=["benchmarks"])


@router.get("", responses=problems())
@heavy_read
def list_benchmarks(caller: Reader) -> list[BenchmarkView]:
    """Lists the benchmarks."""
    return [_view(benchmark) for benchmark in offered_benchmarks()]


@router.get("/{name}", responses=problems(404))
def get_benchmark(name: Name, caller: Reader) -> BenchmarkView:
    """One benchmark."""
    return _view(find_benchmark(name))


@router.get(
    "/{name}/file",
    response_class=Response,
    responses=problems(404) | {200: {"description": "The file.", "content": {TOML: {"schema": {"type": "string"}}}}},
)
def get_benchmark_file(name: Name, caller: Reader) -> Response:
    """The TOML file of one of the organiser's own benchmarks, for `dohyo evaluate --benchmark`; the others ship."""
    return Response(own_file(name), media_type=TOML)


@router.get("/{name}/versions", responses=problems(404))
def list_benchmark_versions(name: Name, caller: Reader, services: ServicesOf) -> list[BenchmarkVersionView]:
    """Versions of a benchmark: the current one and those that were evaluated on this server, newest first."""
    current = find_benchmark(name).sha256
    with services.database.reading() as session:
        rows = count_by_version(session, name)
    known = [
        BenchmarkVersionView(version=sha256, current=sha256 == current, first_evaluated=created, evaluations=count)
        for sha256, created, count in rows
    ]
    if any(one.current for one in known):
        return known
    return [BenchmarkVersionView(version=current, current=True, first_evaluated=None, evaluations=0), *known]


def _view(benchmark: AnyBenchmark) -> BenchmarkView:
    if isinstance(benchmark, Benchmark):
        facts: dict[str, Any] = {
            "kind": Family.DRIVING,
            "rules": benchmark.rules,
            "networks": list(benchmark.networks),
            "cells": [cell.name for cell in benchmark.cells],
            "egos": list(benchmark.shared_egos),
        }
    elif isinstance(benchmark, ParkingBenchmark):
        facts = {"kind": Family.PARKING, "rules": None, "networks": [], "cells": [LOT], "egos": []}
    elif isinstance(benchmark, ForecastBenchmark):
        facts = {"kind": Family.FORECASTING, "rules": None, "networks": [benchmark.network], "cells": [DAY]}
        facts |= {"egos": []}
    else:
        facts = {"kind": Family.FREEWAY, "rules": None, "networks": [benchmark.network], "cells": [MORNING]}
        facts |= {"egos": []}
    return BenchmarkView(
        name=benchmark.name,
        version=benchmark.sha256,
        description=benchmark.description,
        headline=benchmark.headline,
        metric=benchmark.metric,
        scenarios=benchmark.size,
        seeds=list(benchmark.seeds),
        **facts,
    )
