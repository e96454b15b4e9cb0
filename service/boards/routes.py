"""The leaderboard: JSON and CSV."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import msgspec
from fastapi import APIRouter, Query, Response

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.service.accounts.access import Caller, Reader
from dohyo.service.boards import queries as reading
from dohyo.service.boards.leaderboard import Row, as_csv, as_document
from dohyo.service.boards.views import LeaderboardView
from dohyo.service.episodes.readers import Readers, ReadersOf, owner_filter
from dohyo.service.state import Services, ServicesOf
from dohyo.service.web.documents import problems
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

router = APIRouter(prefix="/v1", tags=["leaderboard"], responses=problems(404))

BenchmarkName = Annotated[
    str, Query(min_length=1, max_length=100, pattern=r"^[A-Za-z0-9._-]+$", examples=["quickstart"])
]
VersionHash = Annotated[
    str | None, Query(pattern=r"^[0-9a-f]{8,64}$", description="Content hash or its beginning; by default the newest.")
]
TrackName = Annotated[
    Literal["sensors", "map", "privileged"] | None, Query(description="By default all, ranked as one.")
]
CSV: dict[int | str, dict[str, Any]] = {
    200: {"description": "A row per submission.", "content": {"text/csv": {"schema": {"type": "string"}}}}
}


@dataclass(frozen=True, slots=True)
class _Board:
    """The requested benchmark version and its ranked entries."""

    benchmark: Benchmark
    version: str
    versions: list[str]
    rows: list[Row]


@router.get("/leaderboard", response_model=LeaderboardView)
def get_leaderboard(
    caller: Reader,
    services: ServicesOf,
    readers: ReadersOf,
    benchmark: BenchmarkName,
    version: VersionHash = None,
    track: TrackName = None,
) -> Response:
    """Complete, reproducible evaluations, the latest of each submission, by the benchmark's headline score."""
    board = _board(services, readers, caller, benchmark, version, track)
    document = {
        "benchmark": board.benchmark.name,
        "version": board.version,
        "versions": board.versions,
        "track": track,
        "metric": board.benchmark.headline,
        "description": board.benchmark.metric,
        "rows": [as_document(row, board.benchmark.headline) for row in board.rows],
    }
    return Response(msgspec.json.encode(document), media_type="application/json")


@router.get("/leaderboard.csv", response_class=Response, responses=CSV)
def get_leaderboard_csv(
    caller: Reader,
    services: ServicesOf,
    readers: ReadersOf,
    benchmark: BenchmarkName,
    version: VersionHash = None,
    track: TrackName = None,
) -> Response:
    """The leaderboard as CSV."""
    board = _board(services, readers, caller, benchmark, version, track)
    return Response(as_csv(board.rows, board.benchmark.headline), media_type="text/csv")


def _board(
    services: Services, readers: Readers, caller: Caller, name: str, version: str | None, track: str | None
) -> _Board:
    with services.database.reading() as session:
        known = reading.benchmark_versions(session, name)
        found = [one for one in known if one.sha256.startswith(version or "")]
        if version and len(found) > 1:
            raise InvalidInputError(f"version '{version}' of benchmark '{name}' could be any of {len(found)}")
        if found:
            benchmark, sha256 = readers.benchmark(found[0]), found[0].sha256
        else:
            benchmark = _unevaluated(name, version, reading.benchmark_names(session))
            sha256 = benchmark.sha256
        rows = readers.standings.rows(session, sha256, track, owner_filter(caller), benchmark.headline)
    return _Board(benchmark, sha256, [one.sha256 for one in known], rows)


def _unevaluated(name: str, version: str | None, evaluated: list[str]) -> Benchmark:
    """A benchmark that has no evaluation yet.

    Raises:
        UnknownNameError: No benchmark has this name and version; file names are refused too.
    """
    if name.endswith(".toml"):
        raise UnknownNameError("benchmark", name, evaluated)
    benchmark = load_benchmark(name)
    if version and not benchmark.sha256.startswith(version):
        raise UnknownNameError(f"version of benchmark '{name}'", version, [benchmark.sha256])
    return benchmark
