"""A service in a process of its own: what the tests of live episodes kill, stop and start again."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from dohyo.evaluation.agent import agent_info, make_agent
from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord
from dohyo.evaluation.records.store import read_record
from dohyo.service.accounts.model import Role
from dohyo.service.accounts.queries import create_token
from dohyo.service.benchmarks.catalog import AnyBenchmark
from dohyo.service.database.base import new_id
from dohyo.service.database.engine import Database
from dohyo.service.episodes.archive import archived_path
from dohyo.service.evaluations.model import Attempt, Episode, EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.evaluations.queries import add_evaluation
from dohyo.service.settings import Settings
from dohyo.service.submissions.model import Agent, AgentKind, Submission
from dohyo.sumo_networks.scenario import Mission, Place, Traffic
from tests.forked import Python, dohyo
from tests.service.tables import sqlite_with_tables

ROOT = Path(__file__).parents[2]
STEADY = "tests.evaluation.agents:Steady"
PATIENCE_S = 300.0


def short(missions: int = 1, goal_m: float = 30.0, name: str = "short") -> Benchmark:
    """Short drives along one street of Ingolstadt, with nobody else there."""
    return Benchmark(
        name=name,
        description="for tests",
        headline=Headline.DRIVING_SCORE,
        metric="driving score",
        network="ingolstadt",
        traffic=Traffic(warm_up_s=0.0),
        missions=tuple(
            Mission(
                name=f"drive-{i}",
                start=Place(lane="737320747#3_2", position_m=5.0 + 8 * i),
                goal=Place(lane="737320747#4_2", position_m=goal_m),
            )
            for i in range(missions)
        ),
        seeds=(0,),
    )


def info_of(entry: str, **settings: Any) -> AgentInfo:
    """What a record says of an agent."""
    agent = make_agent(entry, settings)
    try:
        return agent_info(agent, entry, settings)
    finally:
        agent.close()


class Service:
    """One service, in a process that can be killed and started again on the same data.

    Attributes:
        data: Its folder.
        port: Where it listens.
        url: Of it.
        token: Of a worker of "owner".
        submitter_token: Of "owner".
        other_token: Of a worker of somebody else.
    """

    def __init__(self, data: Path, **settings: Any) -> None:
        self.data = data
        self.environment = {f"DOHYO_{key.upper()}": str(value) for key, value in settings.items()}
        self.settings = Settings(data=data, **settings)
        if self.settings.database is None:
            sqlite_with_tables(data / "dohyo.db")
        self.database = Database(self.settings.database_url)
        with self.database.session() as session:
            self.token = create_token(session, "owner", Role.WORKER)[1]
            self.submitter_token = create_token(session, "owner", Role.SUBMITTER)[1]
            self.other_token = create_token(session, "somebody-else", Role.WORKER)[1]
        self.port = _free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self.process: Python | None = None

    def start(self) -> None:
        """Starts the process and waits until it listens."""
        serve = ["serve", "--data", str(self.data), "--port", str(self.port)]
        self.process = dohyo(*serve, env=os.environ | self.environment)
        wait_until(self._listens, "the service does not listen")

    def _listens(self) -> bool:
        assert self.process is not None
        assert self.process.poll() is None, f"the service ended at its start: {self.process.errors()}"
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def kill(self) -> None:
        """kill -9."""
        assert self.process is not None
        self.process.end(signal.SIGKILL)

    def terminate(self) -> int:
        """SIGTERM, and what it ends with."""
        assert self.process is not None
        return self.process.end(signal.SIGTERM)

    def close(self) -> None:
        """Whatever it does, it is gone afterwards."""
        if self.process is not None and self.process.poll() is None:
            self.process.end(signal.SIGKILL)
        self.database.close()

    def episode_processes(self) -> list[int]:
        """Identifiers of its episode processes."""
        assert self.process is not None
        servers = _children(self.process.pid, "dohyo-fork")
        return [episode for server in servers for episode in _children(server, "dohyo-episode")]

    def submit(
        self,
        info: AgentInfo,
        benchmark: AnyBenchmark,
        *,
        kind: AgentKind = AgentKind.REMOTE,
        seeds: Sequence[int] = (0,),
        owner: str = "owner",
        slow_policy: str = "wait",
        act_deadline_s: float = 10.0,
        others: Mapping[str, AgentInfo] = MappingProxyType({}),
    ) -> str:
        """Queues an evaluation of an agent, which is made on the way; so are the agents of single egos."""
        with self.database.session() as session:
            submission = _submission(session, info, kind, owner)
            drivers = {ego: _submission(session, other, kind, owner) for ego, other in others.items()}
            evaluation = add_evaluation(
                session,
                owner,
                submission,
                benchmark,
                seeds,
                benchmark.scenarios(seeds),
                slow_policy=slow_policy,
                act_deadline_s=act_deadline_s,
                others=drivers,
            )
            return evaluation.id

    def evaluation(self, evaluation_id: str) -> Evaluation:
        """As it stands."""
        with self.database.reading() as session:
            found = session.get(Evaluation, evaluation_id)
            assert found is not None
            return found

    def episodes(self, evaluation_id: str) -> list[Episode]:
        """As they stand, in order."""
        with self.database.reading() as session:
            query = select(Episode).where(Episode.evaluation_id == evaluation_id).order_by(Episode.position)
            return list(session.scalars(query))

    def attempts(self, evaluation_id: str) -> list[Attempt]:
        """All attempts of an evaluation, in the order of their start."""
        with self.database.reading() as session:
            query = select(Attempt).join(Episode).where(Episode.evaluation_id == evaluation_id)
            return list(session.scalars(query.order_by(Attempt.started)))

    def wait(self, evaluation_id: str, patience_s: float = PATIENCE_S) -> Evaluation:
        """Waits until an evaluation has ended."""
        wait_until(lambda: self.evaluation(evaluation_id).status.finished, "the evaluation does not end", patience_s)
        return self.evaluation(evaluation_id)

    def wait_done(self, evaluation_id: str, count: int = 1) -> None:
        """Waits until so many episodes of an evaluation are done."""
        wait_until(
            lambda: sum(one.status is EpisodeStatus.DONE for one in self.episodes(evaluation_id)) >= count,
            "no episode is done",
        )

    def hashes(self, evaluation_id: str) -> list[str | None]:
        """Of the records of an evaluation, in order; it must be done."""
        ended = self.wait(evaluation_id)
        assert ended.status is EvaluationStatus.DONE, ended.failure
        return [one.record_hash for one in self.episodes(evaluation_id)]

    def record(self, evaluation_id: str, position: int = 0) -> EpisodeRecord:
        """A record of an evaluation that is done."""
        record_hash = self.hashes(evaluation_id)[position]
        assert record_hash is not None
        return read_record(archived_path(self.settings, record_hash))


def _submission(session: Session, info: AgentInfo, kind: AgentKind, owner: str) -> Submission:
    """The next version of an agent."""
    agent = session.scalar(select(Agent).where(Agent.name == info.name))
    if agent is None:
        agent = Agent(id=new_id("ag"), name=info.name, owner=owner)
        session.add(agent)
        session.flush()
    version = 1 + len(session.scalars(select(Submission).where(Submission.agent_id == agent.id)).all())
    submission = Submission(
        id=new_id("su"), agent_id=agent.id, version=version, kind=kind, track=info.track, info=info.model_dump()
    )
    session.add(submission)
    session.flush()
    return submission


def wait_until(true: Callable[[], bool], otherwise: str, patience_s: float = PATIENCE_S) -> None:
    """Waits until something holds."""
    ends = time.monotonic() + patience_s
    while not true():
        assert time.monotonic() < ends, otherwise
        time.sleep(0.05)


def _children(parent: int, name: str) -> list[int]:
    found = subprocess.run(["pgrep", "-P", str(parent), "-x", name], capture_output=True, text=True, check=False)
    return [int(line) for line in found.stdout.split()]


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
