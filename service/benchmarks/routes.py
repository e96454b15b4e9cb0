"""Benchmarks: those that ship with dohyo, and their versions that were evaluated on this server."""

from __future__ import annotations

from fastapi import APIRouter

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.benchmarks.documents import benchmark_names
from dohyo.service.accounts.access import Reader
from dohyo.service.benchmarks.views import BenchmarkVersionView, BenchmarkView
from dohyo.service.evaluations.queries import count_by_version
from dohyo.service.state import ServicesOf
from dohyo.service.web.documents import Name, problems
from dohyo.sumo_networks.errors import UnknownNameError

router = APIRouter(prefix="/v1/benchmarks", tags=["benchmarks"])


@router.get("", responses=problems())
def list_benchmarks(caller: Reader) -> list[BenchmarkView]:
    """Lists the benchmarks."""
    return [_view(load_benchmark(name)) for name in benchmark_names()]


@router.get("/{name}", responses=problems(404))
def get_benchmark(name: Name, caller: Reader) -> BenchmarkView:
    """One benchmark."""
    return _view(find_benchmark(name))


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


def find_benchmark(name: str) -> Benchmark:
    """A benchmark of the catalog by its name; a name is never used as a path.

    Raises:
        UnknownNameError: There is none.
    """
    if name not in benchmark_names():
        raise UnknownNameError("benchmark", name, benchmark_names())
    return load_benchmark(name)


def _view(benchmark: Benchmark) -> BenchmarkView:
    return BenchmarkView(
        name=benchmark.name,
        version=benchmark.sha256,
        description=benchmark.description,
        headline=benchmark.headline,
        metric=benchmark.metric,
        rules=benchmark.rules,
        networks=list(benchmark.networks),
        cells=[cell.name for cell in benchmark.cells],
        scenarios=benchmark.size,
        seeds=list(benchmark.seeds),
    )
