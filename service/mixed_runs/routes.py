"""The cross-play of a benchmark: its agents beside each other in mixed runs."""

from __future__ import annotations

from typing import Final

import msgspec
from fastapi import APIRouter, Response

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.service.accounts.access import Caller, Reader
from dohyo.service.boards import queries as reading
from dohyo.service.boards.versions import VersionHash, find_version
from dohyo.service.episodes.readers import Readers, ReadersOf
from dohyo.service.errors import NotFoundError
from dohyo.service.evaluations.access import Aspect, seen_by
from dohyo.service.evaluations.versions import newest
from dohyo.service.mixed_runs.views import CrossPlayView
from dohyo.service.state import Services, ServicesOf
from dohyo.service.web.documents import Name, problems
from dohyo.service.web.heavy import heavy_read

router = APIRouter(prefix="/v1/benchmarks", tags=["leaderboard"], responses=problems(404))

MOST_RUNS: Final = 100
"""Mixed runs that are read, and runs of one agent beside them: the newest of each."""


@router.get("/{name}/cross-play", response_model=CrossPlayView)
@heavy_read
def get_cross_play(
    name: Name, caller: Reader, services: ServicesOf, readers: ReadersOf, version: VersionHash = None
) -> Response:
    """Headline score of each agent beside each other one, from the complete mixed runs that the caller may read.

    An agent beside itself are its complete runs alone, with copies of itself in all egos. At most 100 runs of either
    kind count, of their owners in turn, each owner's newest first: those of the newest version of dohyo that drove a
    mixed run, since versions may drive and judge differently. Runs are practice: anybody can order them, with any
    seeds.
    """
    document = _cross_play(services, readers, caller, name, version)
    return Response(msgspec.json.encode(document), media_type="application/json")


def _cross_play(
    services: Services, readers: Readers, caller: Caller, name: str, version: str | None
) -> dict[str, object]:
    seen = seen_by(caller, Aspect.RECORDS)
    with services.database.reading() as session:
        benchmark, versions = find_version(session, readers, name, version)
        if not isinstance(benchmark, Benchmark) or not benchmark.shared_egos:
            raise NotFoundError(f"benchmark '{name}' has no cross-play: each of its egos drives alone")
        plays, metric = readers.cross_plays, benchmark.headline
        by_version = reading.mixed_runs_by_version(session, benchmark.sha256, seen)
        dohyo = newest([one for one in by_version if one is not None])
        runs = reading.mixed_runs(session, benchmark.sha256, dohyo, seen, MOST_RUNS)
        mixed = plays.meetings(session, runs, metric)
        met = {own.submission for meetings in mixed.values() for own, _ in meetings}
        runs = reading.runs_alone(session, benchmark.sha256, dohyo, met, seen, MOST_RUNS)
        alone = plays.meetings(session, runs, metric)
    return {
        "benchmark": benchmark.name,
        "version": benchmark.sha256,
        "versions": versions,
        "metric": metric,
        "description": benchmark.metric,
        "runs": len(mixed),
        "dohyo_version": dohyo,
        "other_versions": sum(by_version.values()) - by_version.get(dohyo, 0),
        **plays.matrix(mixed, alone, metric),
    }
