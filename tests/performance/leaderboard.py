"""How fast a page of a leaderboard of 10,000 runs with 18 episodes each answers over HTTP, on PostgreSQL.

`python tests/performance/leaderboard.py [--json FILE] [--runs N] [--sqlite]`

The results of the runs are stored before, as a running service has done at each run's end. Measured are the first page
after the start of the server, the same after one more run, the first page again (p50, p99), and the last page.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from datetime import datetime, timedelta
from http.client import HTTPConnection
from pathlib import Path
from typing import Any, cast

import numpy as np
import uvicorn
from fastapi import FastAPI
from sqlalchemy import insert as sql_insert
from sqlalchemy import select, text
from sqlalchemy.orm import Session

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.service.boards import routes as leaderboard
from dohyo.service.boards.model import Result
from dohyo.service.boards.rankings import open_ranking, open_ranking_id
from dohyo.service.boards.results import store_results
from dohyo.service.database.base import Base, now
from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import Episode, EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.settings import Settings
from dohyo.service.state import Broadcast, Services
from dohyo.service.submissions.model import Agent, AgentKind, Submission
from tests.service import postgres

RUNS, EPISODES, WARM, PAGE = 10_000, 18, 100, 100


def rows(run: int, sha256: str, generator: np.random.Generator, finished: datetime) -> dict[type[Base], list[Any]]:
    """The rows of one agent, one submission, one finished ranked run with its episodes."""
    name, level = f"agent{run}", float(generator.uniform(20, 90))
    scores = np.clip(generator.normal(level, 20, EPISODES), 0, 100)
    agent = {"id": name, "name": name, "owner": "owner"}
    submission = {"id": f"s-{name}", "agent_id": name, "version": 1, "kind": AgentKind.BUILTIN, "track": "privileged"}
    evaluation = {"id": f"e-{name}", "owner": "owner", "submission_id": f"s-{name}", "benchmark_sha256": sha256}
    evaluation |= {"ranking_id": open_ranking_id(sha256), "seeds": [0, 1, 2], "status": EvaluationStatus.DONE}
    episodes = [episode(f"e-{name}", position, float(score)) for position, score in enumerate(scores)]
    return {
        Agent: [agent],
        Submission: [submission | {"info": {}}],
        Evaluation: [evaluation | {"act_deadline_s": 10.0, "created": finished, "finished": finished}],
        Episode: episodes,
    }


def stored_result(run: int, sha256: str, facts: dict[str, Any], episodes: list[Any], finished: datetime) -> Any:
    """The stored result of a run: the facts of another one, with its own scores."""
    values = [one["summary"]["egos"][0]["ds"] for one in episodes]
    return {
        "evaluation_id": f"e-agent{run}",
        "ranking_id": open_ranking_id(sha256),
        "entrant": f"s-agent{run}",
        "track": "privileged",
        "score": float(np.mean(values)),
        "ordered": finished,
        "finished": finished,
        "facts": facts | {"values": values},
    }


def episode(evaluation: str, position: int, score: float) -> dict[str, Any]:
    """A finished episode whose ego had one collision."""
    facts = {"name": "ego", "status": "completed", "success": True, "nocrash": False, "ds": score, "rc": 100.0}
    facts |= {
        "ip": score / 100,
        "irs": score / 2,
        "road": 50.0,
        "drove": False,
        "infractions": {"collision_vehicle": 1},
        "km": 1.0,
    }
    facts |= {"route_m": 1000.0, "driven_m": 1000.0, "duration_s": 120.0}
    place = {"scenario": f"scenario{position % 6}", "cell": "all", "seed": position // 6, "position": position}
    summary = {"egos": [facts], "decision_ms": [1.0, 2.0, 3.0], "wall_s": 5.0}
    known = {"id": f"{evaluation}-{position}", "evaluation_id": evaluation, "status": EpisodeStatus.DONE}
    return known | place | {"summary": summary}


@contextmanager
def serving(database: Database, folder: Path) -> Iterator[Callable[..., float]]:
    """The leaderboard's routes behind uvicorn on a free port; gives a function that asks once and returns the ms."""
    app = FastAPI()
    app.include_router(leaderboard.router)
    app.state.services = Services(Settings(data=folder), database, cast(Any, None), Broadcast())
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_level="warning"))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    connection = HTTPConnection("127.0.0.1", server.servers[0].sockets[0].getsockname()[1])

    def once(after: str = "", expected: bytes = b'"rank":1,') -> float:
        began = time.perf_counter()
        connection.request("GET", f"/v1/leaderboard?benchmark=made&limit={PAGE}{after and f'&after={after}'}")
        answer = connection.getresponse()
        content = answer.read()
        if answer.status != 200 or expected not in content:
            raise RuntimeError(f"the leaderboard answered {answer.status}")
        return 1000 * (time.perf_counter() - began)

    yield once
    server.should_exit = True
    thread.join()


def prepare(database: Database, benchmark: Benchmark, settings: Settings, runs: int) -> None:
    """Tables with so many complete runs and their results; the first run's are computed, the others' made up."""
    Base.metadata.create_all(database.engine)
    generator, began = np.random.default_rng(0), now() - timedelta(days=1)
    with database.session() as session:
        ranking = open_ranking(session, benchmark, settings)
        insert(session, rows(0, benchmark.sha256, generator, began))
        store_results(session, ranking, benchmark.headline)
        facts = session.scalars(select(Result.facts)).one()
    for start in range(1, runs, 500):
        with database.session() as session:
            for run in range(start, min(start + 500, runs)):
                finished = began + timedelta(seconds=run)
                made = rows(run, benchmark.sha256, generator, finished)
                insert(session, made | {Result: [stored_result(run, benchmark.sha256, facts, made[Episode], finished)]})
    if not database.is_sqlite:
        with database.session() as session:
            session.execute(text("ANALYZE"))


def insert(session: Session, made: dict[type[Base], list[Any]]) -> None:
    """Writes rows in the order of their tables."""
    for table, some in made.items():
        session.execute(sql_insert(table), some)


def measure(folder: Path, url: str, runs: int) -> dict[str, float]:
    """Milliseconds."""
    database, settings = Database(url), Settings(data=folder)
    benchmark = load_benchmark("quickstart").model_copy(update={"name": "made"})
    prepare(database, benchmark, settings, runs)
    with serving(database, folder) as once:
        cold = once()
        with database.session() as session:
            insert(session, rows(runs, benchmark.sha256, np.random.default_rng(1), now()))
        one_more = once()
        warm = sorted(once() for _ in range(WARM))
        places = ids_in_order(database)
        last = once(after=places[-PAGE - 1], expected=places[-1].encode())
    database.close()
    times = {"cold_ms": cold, "one_more_ms": one_more, "warm_p50_ms": warm[WARM // 2], "warm_p99_ms": warm[-1]}
    return times | {"last_page_ms": last}


def ids_in_order(database: Database) -> list[str]:
    """Evaluations in the order of the board."""
    with database.reading() as session:
        query = select(Result.evaluation_id).order_by(Result.score.desc(), Result.ordered, Result.evaluation_id)
        return list(session.scalars(query))


def main() -> None:
    """Prints the times, and writes them where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--sqlite", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, nullcontext("") if options.sqlite else postgres.running() as server:
        url = postgres.fresh_database(server, "leaderboard") if server else f"sqlite:///{folder}/leaderboard.db"
        times = measure(Path(folder), url, options.runs)
    for name, value in times.items():
        print(f"{name:12} {value:10.2f}")
    if options.json:
        options.json.write_text(json.dumps(times, indent=1))


if __name__ == "__main__":
    main()
