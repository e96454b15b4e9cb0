"""A service with hand-made records in its archive: no scheduler, no simulation."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from functools import cache
from pathlib import Path
from typing import Any, cast

from fastapi import FastAPI
from fastapi.testclient import TestClient

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.store import seal, write_record
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.service import errors
from dohyo.service.accounts.model import Role
from dohyo.service.accounts.queries import create_token
from dohyo.service.boards import comparison_routes as comparison
from dohyo.service.boards import routes as leaderboard
from dohyo.service.boards.rankings import open_ranking, open_ranking_id
from dohyo.service.database.base import Base, new_id, now
from dohyo.service.database.engine import Database
from dohyo.service.episodes import routes as episodes
from dohyo.service.episodes.archive import archived_path
from dohyo.service.evaluations import metrics_routes as metrics
from dohyo.service.evaluations import rescoring_routes as rescoring
from dohyo.service.evaluations.model import BenchmarkVersion, Episode, EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.evaluations.scoring import summary_of
from dohyo.service.jobs.kinds import KINDS
from dohyo.service.mixed_runs import routes as cross_play
from dohyo.service.monitoring import routes as monitoring
from dohyo.service.settings import Settings
from dohyo.service.state import Broadcast, Services
from dohyo.service.submissions.model import Agent, AgentKind, Submission
from tests.evaluation.builders import AGENT, drive

BENCHMARK = {
    "name": "made",
    "description": "Made by hand",
    "headline": "driving_score",
    "metric": "driving score: made by hand",
    "network": "ingolstadt",
    "missions": [{"start": {"lane": "E_0"}, "goal": {"lane": "E_0"}, "name": "m"}],
}


class FakeScheduler:
    """Does nothing, and says so."""

    def snapshot(self) -> dict[str, Any]:
        return {"running": 2, "queued": 3, "draining": False, "workers": 1}


@cache
def routes_of_all() -> list[Any]:
    """The routes of every shop: FastAPI analyses them at the first request, which takes longer than most tests."""
    app = FastAPI()
    for module in (comparison, cross_play, episodes, leaderboard, metrics, monitoring, rescoring):
        app.include_router(module.router)
    return app.router.routes


class Shop:
    """Fills the database and the archive, and asks the routes.

    Attributes:
        services: As the app has them.
        client: Without a token.
    """

    def __init__(self, folder: Path, *, public: bool = True, url: str | None = None) -> None:
        folder.mkdir()
        settings = Settings(data=folder, public=public, _env_file=None)  # type: ignore[call-arg]
        database = Database(url or settings.database_url)
        Base.metadata.create_all(database.engine)
        self.services = Services(settings, database, cast(Any, FakeScheduler()), Broadcast())
        app = FastAPI(lifespan=self._lifespan)
        errors.install(app)
        app.router.routes[:] = routes_of_all()
        app.state.services = self.services
        self.client = TestClient(app, raise_server_exceptions=False)

    @asynccontextmanager
    async def _lifespan(self, app: FastAPI) -> AsyncIterator[None]:
        """Runs jobs while the client is entered."""
        await self.services.jobs.start(self.services, KINDS)
        yield
        await self.services.jobs.stop()

    def token(self, owner: str, role: Role = Role.SUBMITTER) -> dict[str, str]:
        """Headers of a caller."""
        with self.services.database.session() as session:
            return {"authorization": f"Bearer {create_token(session, owner, role)[1]}"}

    def benchmark(self, **changes: Any) -> str:
        """A benchmark version; its content hash. A change to None takes something away."""
        given = {key: value for key, value in (BENCHMARK | changes).items() if value is not None}
        benchmark = Benchmark.model_validate(given)
        with self.services.database.session() as session:
            if session.get(BenchmarkVersion, benchmark.sha256) is None:
                document = json.loads(benchmark.model_dump_json())
                session.add(BenchmarkVersion(sha256=benchmark.sha256, name=benchmark.name, document=document))
                session.flush()
                open_ranking(session, benchmark, self.services.settings)
        return benchmark.sha256

    def submission(
        self, agent: str, *, owner: str = "ann", track: str = "map", kind: AgentKind = AgentKind.BUILTIN
    ) -> str:
        """The first version of an agent, or its next one."""
        with self.services.database.session() as session:
            if session.get(Agent, f"ag-{agent}") is None:
                session.add(Agent(id=f"ag-{agent}", name=agent, owner=owner))
                session.flush()
            version = session.query(Submission).filter_by(agent_id=f"ag-{agent}").count() + 1
            one = Submission(
                id=new_id("su"),
                agent_id=f"ag-{agent}",
                version=version,
                kind=kind,
                track=track,
                info=AGENT.model_dump(mode="json"),
            )
            session.add(one)
            return one.id

    def evaluation(
        self,
        submission: str,
        records: Sequence[EpisodeRecord],
        *,
        owner: str = "ann",
        benchmark: str | None = None,
        status: EvaluationStatus = EvaluationStatus.DONE,
        trajectory: Trajectory | None = None,
        ranked: bool = True,
        **rest: Any,
    ) -> tuple[str, list[str]]:
        """An evaluation and its finished episodes: their ids. A ranked one is of the benchmark's open ranking."""
        benchmark = benchmark or self.benchmark()
        seeds = sorted({record.scenario.seed for record in records})
        evaluation = new_id("ev")
        ids = []
        with self.services.database.session() as session:
            session.add(
                Evaluation(
                    id=evaluation,
                    owner=owner,
                    submission_id=submission,
                    benchmark_sha256=benchmark,
                    seeds=seeds,
                    status=status,
                    act_deadline_s=10.0,
                    finished=now() if status.finished else None,
                    ranking_id=open_ranking_id(benchmark) if ranked else None,
                    dohyo_versions=sorted({record.versions.dohyo for record in records}),
                    **rest,
                )
            )
            session.flush()
            for position, record in enumerate(records):
                sealed = seal(record)
                path = archived_path(self.services.settings, sealed.record_hash)
                write_record(path.parent, path.stem, sealed, trajectory or drive())
                ids.append(new_id("ep"))
                session.add(
                    Episode(
                        id=ids[-1],
                        evaluation_id=evaluation,
                        position=position,
                        scenario=record.scenario.name,
                        cell=record.scenario.cell,
                        seed=record.scenario.seed,
                        status=EpisodeStatus.DONE,
                        record_hash=sealed.record_hash,
                        kept_bytes=path.stat().st_size,
                        summary=json.loads(json.dumps(summary_of(sealed, "2.0"))),
                    )
                )
        return evaluation, ids

    def path(self, episode: str) -> Path:
        """Where the record of an episode is."""
        with self.services.database.reading() as session:
            found = session.get(Episode, episode)
            assert found is not None
            assert found.record_hash is not None
            return archived_path(self.services.settings, found.record_hash)
