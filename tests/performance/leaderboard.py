"""How fast a leaderboard of 50 submissions with 300 episodes each answers over HTTP: cold, one more added, warm.

`python tests/performance/leaderboard.py [--json FILE]`
"""

from __future__ import annotations

import argparse
import json
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import Any, cast

import numpy as np
import uvicorn
from fastapi import FastAPI
from sqlalchemy.orm import Session

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.service.boards import routes as leaderboard
from dohyo.service.database.base import Base
from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import BenchmarkVersion, Episode, EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.settings import Settings
from dohyo.service.state import Broadcast, Services
from dohyo.service.submissions.model import Agent, AgentKind, Submission

SUBMISSIONS, EPISODES, WARM = 50, 300, 200
SHA256 = "b" * 64


def fill(session: Session, submission: int, generator: np.random.Generator) -> None:
    """One agent, one submission, one finished evaluation."""
    name = f"agent{submission}"
    session.add(Agent(id=name, name=name, owner="owner"))
    session.add(
        Submission(id=f"s-{name}", agent_id=name, version=1, kind=AgentKind.BUILTIN, track="privileged", info={})
    )
    evaluation = Evaluation(
        id=f"e-{name}",
        owner="owner",
        submission_id=f"s-{name}",
        benchmark_sha256=SHA256,
        seeds=[0, 1, 2],
        status=EvaluationStatus.DONE,
        act_deadline_s=10.0,
    )
    session.add(evaluation)
    for position in range(EPISODES):
        session.add(episode(f"e-{name}", position, float(np.clip(generator.normal(60 + submission / 10, 20), 0, 100))))


def episode(evaluation: str, position: int, score: float) -> Episode:
    """A finished episode whose ego had one collision."""
    facts = {"name": "ego", "status": "completed", "success": True, "nocrash": False, "ds": score, "rc": 100.0}
    facts |= {"ip": score / 100, "irs": score / 2, "road": 50.0, "infractions": {"collision_vehicle": 1}, "km": 1.0}
    facts |= {"route_m": 1000.0, "driven_m": 1000.0, "duration_s": 120.0}
    return Episode(
        id=f"{evaluation}-{position}",
        evaluation_id=evaluation,
        position=position,
        scenario=f"scenario{position % 100}",
        cell="all",
        seed=position // 100,
        status=EpisodeStatus.DONE,
        summary={"egos": [facts], "decision_ms": [1.0, 2.0, 3.0], "wall_s": 5.0},
    )


@contextmanager
def serving(database: Database, folder: Path) -> Iterator[Callable[[], float]]:
    """The leaderboard's routes behind uvicorn on a free port; gives what asks once and tells the milliseconds."""
    app = FastAPI()
    app.include_router(leaderboard.router)
    app.state.services = Services(Settings(data=folder), database, cast(Any, None), Broadcast())
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_level="warning"))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    connection = HTTPConnection("127.0.0.1", server.servers[0].sockets[0].getsockname()[1])

    def once() -> float:
        began = time.perf_counter()
        connection.request("GET", "/v1/leaderboard?benchmark=made&track=privileged")
        answer = connection.getresponse()
        if answer.status != 200 or b'"rank":1,' not in answer.read():
            raise RuntimeError(f"the leaderboard answered {answer.status}")
        return 1000 * (time.perf_counter() - began)

    yield once
    server.should_exit = True
    thread.join()


def measure(folder: Path) -> dict[str, float]:
    """Milliseconds."""
    generator = np.random.default_rng(0)
    database = Database(f"sqlite:///{folder / 'leaderboard.db'}")
    Base.metadata.create_all(database.engine)
    benchmark = load_benchmark("quickstart").model_copy(update={"name": "made"})
    with database.session() as session:
        document = json.loads(benchmark.model_dump_json())
        session.add(BenchmarkVersion(sha256=SHA256, name="made", document=document))
        for submission in range(SUBMISSIONS):
            fill(session, submission, generator)
    with serving(database, folder) as once:
        cold = once()
        with database.session() as session:
            fill(session, SUBMISSIONS, generator)
        one_more = once()
        warm = sorted(once() for _ in range(WARM))
    return {"cold_ms": cold, "one_more_ms": one_more, "warm_p50_ms": warm[WARM // 2], "warm_p99_ms": warm[-WARM // 100]}


def main() -> None:
    """Prints the times, and writes them where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        times = measure(Path(folder))
    for name, value in times.items():
        print(f"{name:12} {value:10.2f}")
    if options.json:
        options.json.write_text(json.dumps(times, indent=1))


if __name__ == "__main__":
    main()
