"""The leaderboard of a ranking, as JSON and CSV; and the ranking itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import msgspec
from fastapi import APIRouter, Query, Response
from sqlalchemy.orm import Session

from dohyo.service.accounts.access import Caller, Reader
from dohyo.service.benchmarks.catalog import AnyBenchmark, family_of
from dohyo.service.boards import queries as reading
from dohyo.service.boards.board import rows_of
from dohyo.service.boards.leaderboard import as_csv
from dohyo.service.boards.model import Ranking
from dohyo.service.boards.ranking_views import RankingView
from dohyo.service.boards.rankings import open_ranking_id, ranking_for
from dohyo.service.boards.versions import VersionHash, find_version
from dohyo.service.boards.views import LeaderboardView
from dohyo.service.challenges.closing import final_rows
from dohyo.service.episodes.readers import Readers, ReadersOf
from dohyo.service.errors import ForbiddenError
from dohyo.service.evaluations.access import own_runs
from dohyo.service.evaluations.model import BenchmarkVersion
from dohyo.service.state import Services, ServicesOf
from dohyo.service.web.documents import After, Identifier, Limit, problems
from dohyo.service.web.heavy import heavy_read
from dohyo.service.web.spelling import BENCHMARK_NAME
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

router = APIRouter(prefix="/v1", tags=["leaderboard"], responses=problems(403, 404))

BenchmarkName = Annotated[
    str | None,
    Query(
        min_length=1,
        max_length=100,
        pattern=BENCHMARK_NAME,
        examples=["quickstart"],
        description="For the board of its open ranking; not needed beside `ranking`.",
    ),
]
TrackName = Annotated[
    Literal["sensors", "map", "privileged"] | None,
    Query(description="By default all, ranked as one. A final board is not divided by tracks."),
]
RankingId = Annotated[str | None, Query(max_length=40, description="For the board of a challenge's phase.")]
CSV: dict[int | str, dict[str, Any]] = {
    200: {"description": "A row per place.", "content": {"text/csv": {"schema": {"type": "string"}}}}
}


@dataclass(frozen=True, slots=True)
class _Board:
    """The requested benchmark version, its ranking, and a page of the rows."""

    benchmark: AnyBenchmark
    version: str
    versions: list[str]
    ranking: RankingView | None
    total: int
    rows: list[dict[str, Any]]
    next: str | None


@router.get("/leaderboard", response_model=LeaderboardView)
@heavy_read
def get_leaderboard(
    caller: Reader,
    services: ServicesOf,
    readers: ReadersOf,
    benchmark: BenchmarkName = None,
    version: VersionHash = None,
    track: TrackName = None,
    ranking: RankingId = None,
    limit: Limit = 100,
    after: After = None,
) -> Response:
    """Complete ranked runs, one for each entrant, by the benchmark's headline score; of a phase or an open ranking.

    An entrant is an agent, or in a challenge a team. Which of its runs counts was fixed beforehand, in `counts`. Runs
    that lost more than a tenth of their drives stand below all others, without a rank.
    """
    board = _board(services, readers, caller, _Question(benchmark, version, track, ranking), limit, after)
    document = {
        "benchmark": board.benchmark.name,
        "version": board.version,
        "versions": board.versions,
        "ranking": board.ranking.model_dump(mode="json") if board.ranking else None,
        "final": board.ranking is not None and board.ranking.state == "final",
        "track": track,
        "metric": board.benchmark.headline,
        "description": board.benchmark.metric,
        "total": board.total,
        "rows": board.rows,
        "next": board.next,
    }
    return Response(msgspec.json.encode(document), media_type="application/json")


@router.get("/leaderboard.csv", response_class=Response, responses=CSV)
@heavy_read
def get_leaderboard_csv(
    caller: Reader,
    services: ServicesOf,
    readers: ReadersOf,
    benchmark: BenchmarkName = None,
    version: VersionHash = None,
    track: TrackName = None,
    ranking: RankingId = None,
) -> Response:
    """The whole leaderboard as CSV."""
    board = _board(services, readers, caller, _Question(benchmark, version, track, ranking), None, None)
    return Response(as_csv(board.rows, board.benchmark.headline, family_of(board.benchmark)), media_type="text/csv")


@router.get("/rankings/{identifier}")
def get_ranking(identifier: Identifier, caller: Reader, services: ServicesOf) -> RankingView:
    """How runs count in a phase of a challenge or in the open ranking of a benchmark version."""
    with services.database.reading() as session:
        return ranking_for(session, caller, identifier)[1]


@dataclass(frozen=True, slots=True)
class _Question:
    """What is asked for: a phase, or the open ranking of a benchmark version."""

    benchmark: str | None
    version: str | None
    track: str | None
    ranking: str | None


def _board(
    services: Services, readers: Readers, caller: Caller, asked: _Question, limit: int | None, after: str | None
) -> _Board:
    with services.database.reading() as session:
        benchmark, identifier = _ranked_benchmark(session, readers, asked)
        versions = [one.sha256 for one in reading.benchmark_versions(session, benchmark.name)]
        if session.get(Ranking, identifier) is None:
            return _Board(benchmark, benchmark.sha256, versions, None, 0, [], None)
        ranking, view = ranking_for(session, caller, identifier)
        only = None if view.board_visible else _own(session, caller, ranking)
    if ranking.ended():
        rows = final_rows(services.database, readers.standings, ranking, benchmark.headline)
        page, total, follows = _page(rows, [row["evaluation"] for row in rows], limit, after)
        return _Board(benchmark, view.benchmark_version, versions, view, total, rows[page], follows)
    places = readers.standings.places(services.database, ranking, benchmark.headline, track=asked.track, only=only)
    page, total, follows = _page(places, [one.contender.evaluation for one in places], limit, after)
    with services.database.reading() as session:
        rows = rows_of(session, ranking, places, page.start, page.stop)
    return _Board(benchmark, view.benchmark_version, versions, view, total, rows, follows)


def _own(session: Session, caller: Caller, ranking: Ranking) -> frozenset[str]:
    """The caller's own runs: all that it sees of an open ranking on a service that is not public.

    Raises:
        ForbiddenError: The board of a phase is not shown to the caller.
    """
    if ranking.challenge_id is not None:
        raise ForbiddenError(f"the board of phase '{ranking.name}' is shown to its {ranking.board} alone")
    return own_runs(session, caller, ranking.id)


def _page(rows: list[Any], ids: list[str], limit: int | None, after: str | None) -> tuple[slice, int, str | None]:
    """The part of the rows after an evaluation, their total, and the cursor of the next part.

    Raises:
        InvalidInputError: No row has the evaluation.
    """
    start = 0
    if after is not None:
        if after not in ids:
            raise InvalidInputError(f"after: expected the `next` of a page of this board, got '{after}'")
        start = ids.index(after) + 1
    end = len(rows) if limit is None else min(start + limit, len(rows))
    return slice(start, end), len(rows), ids[end - 1] if end < len(rows) else None


def _ranked_benchmark(session: Session, readers: Readers, asked: _Question) -> tuple[AnyBenchmark, str]:
    """The benchmark version and the ranking's identifier.

    Raises:
        InvalidInputError: Neither a benchmark nor a ranking is named, or both.
        UnknownNameError: There is no such ranking, benchmark or version.
    """
    if (asked.benchmark is None) == (asked.ranking is None):
        raise InvalidInputError("expected either a benchmark or a ranking")
    if asked.ranking is not None:
        ranking = session.get(Ranking, asked.ranking)
        if ranking is None:
            raise UnknownNameError("ranking", asked.ranking, [])
        return readers.stored(session.get_one(BenchmarkVersion, ranking.benchmark_sha256)), ranking.id
    benchmark, _ = find_version(session, readers, asked.benchmark or "", asked.version)
    return benchmark, open_ranking_id(benchmark.sha256)
