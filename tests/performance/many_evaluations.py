"""Fills a service's database with many evaluations, as one that has been used for years holds them.

Every run has rows of its own. Episodes and attempts are copied within the database from those of a few patterns, since
a million rows sent one by one take many minutes; scores of the board's runs are made up one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta
from importlib.metadata import version
from typing import Any, Final

import numpy as np
from sqlalchemy import String, insert, literal, select, text
from sqlalchemy.orm import Session

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.service.boards.model import Result
from dohyo.service.boards.queries import entries
from dohyo.service.boards.rankings import open_ranking, open_ranking_id
from dohyo.service.boards.results import facts_of
from dohyo.service.database.base import now
from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import (
    Attempt,
    AttemptOutcome,
    Episode,
    EpisodeStatus,
    Evaluation,
    EvaluationEgo,
    EvaluationStatus,
)
from dohyo.service.settings import Settings
from dohyo.service.submissions.model import Agent, AgentKind, Submission

EPISODES: Final = 48
OWNERS: Final = 50
AGENTS: Final = 20
"""Agents of the mixed runs."""
PATTERNS: Final = 20


class ManyEvaluations:
    """Adds complete runs of a year.

    Attributes:
        board: Benchmark whose ranked runs have an agent each.
        fleet: Benchmark of mixed runs of few agents, and of their ranked runs.
        runs: Number of runs that were added.
    """

    def __init__(self, database: Database, settings: Settings) -> None:
        quickstart, fleet = load_benchmark("quickstart"), load_benchmark("fleet")
        self.board = quickstart.model_copy(update={"seeds": tuple(range(EPISODES // quickstart.size))})
        self.fleet = fleet.model_copy(update={"seeds": tuple(range(EPISODES // fleet.size))})
        self.runs = 0
        self._database, self._began = database, now() - timedelta(days=365)
        self._generator = np.random.default_rng(0)
        self._patterns: dict[str, list[str]] = {}
        self._facts: dict[str, dict[str, Any]] = {}
        with database.session() as session:
            for benchmark in (self.board, self.fleet):
                open_ranking(session, benchmark, settings)
            _add_agents(session, "mixed", range(AGENTS))

    def fill(self, ranked: int, mixed: int) -> None:
        """Adds ranked runs on `board`, a tenth as many on `fleet`, and mixed runs on `fleet`."""
        self.add(self.board, ranked)
        self.add(self.fleet, ranked // 10)
        self.add(self.fleet, mixed, mixed=True)
        if not self._database.is_sqlite:
            with self._database.session() as session:
                session.execute(text("ANALYZE"))

    def add(self, benchmark: Benchmark, count: int, *, mixed: bool = False, stored: bool = True) -> None:
        """Adds runs with their episodes and attempts.

        Args:
            benchmark: Of this object.
            count: Number of runs.
            mixed: Whether they are mixed practice runs; otherwise they are ranked.
            stored: Whether results of ranked runs are stored already, as the first read of a board does.
        """
        numbers = range(self.runs, self.runs + count)
        self.runs += count
        evaluations = [self._evaluation(benchmark, number, mixed) for number in numbers]
        with self._database.session() as session:
            if benchmark is self.board:
                _add_agents(session, "agent", numbers)
            session.execute(insert(Evaluation), evaluations)
            if mixed:
                session.execute(insert(EvaluationEgo), [one for number in numbers for one in self._egos(number)])
            self._add_episodes(session, benchmark, [one["id"] for one in evaluations])
            if stored and not mixed:
                self._add_results(session, benchmark, evaluations)

    def _evaluation(self, benchmark: Benchmark, number: int, mixed: bool) -> dict[str, Any]:
        kind, own = ("agent", number) if benchmark is self.board else ("mixed", number % AGENTS)
        moment = self._began + timedelta(minutes=number)
        return {
            "id": f"ev-{number:06}",
            "owner": f"owner{own % OWNERS}",
            "submission_id": f"su-{kind}{own}",
            "benchmark_sha256": benchmark.sha256,
            "ranking_id": None if mixed else open_ranking_id(benchmark.sha256),
            "seeds": list(benchmark.seeds),
            "status": EvaluationStatus.DONE,
            "act_deadline_s": 10.0,
            "created": moment,
            "started": moment,
            "finished": moment + timedelta(minutes=5),
            "announced": moment + timedelta(minutes=5),
            "dohyo_versions": [version("dohyo")],
        }

    def _egos(self, number: int) -> list[dict[str, str]]:
        """Two egos of a mixed run have other agents than the run's own; all pairs of agents meet in time."""
        others = (number + step for step in (1 + number // AGENTS % (AGENTS - 1), 3))
        return [
            {"evaluation_id": f"ev-{number:06}", "ego": ego, "submission_id": f"su-mixed{other % AGENTS}"}
            for ego, other in zip(self.fleet.shared_egos, others, strict=False)
        ]

    def _add_episodes(self, session: Session, benchmark: Benchmark, ids: Sequence[str]) -> None:
        """The first runs of a benchmark become its patterns, of which all later ones have copies."""
        patterns = self._patterns.setdefault(benchmark.name, [])
        made = ids[: PATTERNS - len(patterns)]
        if made:
            session.execute(
                insert(Episode), [one for identifier in made for one in self._episodes(benchmark, identifier)]
            )
            patterns += made
        for first, pattern in enumerate(patterns):
            _copy_episodes(session, pattern, ids[len(made) + first :: PATTERNS])
        for first in range(0, len(ids), 1000):
            _add_attempts(session, ids[first : first + 1000])

    def _episodes(self, benchmark: Benchmark, evaluation: str) -> list[dict[str, Any]]:
        """Finished episodes of one agent; all of its scores are around one level."""
        names = benchmark.shared_egos or ("ego",)
        scores = np.clip(self._generator.normal(self._generator.uniform(20, 90), 20, (EPISODES, len(names))), 0, 100)
        return [
            {
                "id": f"{evaluation}-{position}",
                "evaluation_id": evaluation,
                "position": position,
                "scenario": f"{benchmark.name}-{position % benchmark.size}",
                "cell": benchmark.cells[0].name,
                "seed": position // benchmark.size,
                "status": EpisodeStatus.DONE,
                "attempts": 1,
                "record_hash": f"{evaluation}-{position}",
                "kept_bytes": 100_000,
                "summary": {
                    "egos": [_drive(name, float(score)) for name, score in zip(names, row, strict=True)],
                    "decision_ms": [1.0, 2.0, 3.0],
                    "wall_s": 5.0,
                },
            }
            for position, row in enumerate(scores)
        ]

    def _add_results(self, session: Session, benchmark: Benchmark, evaluations: Sequence[dict[str, Any]]) -> None:
        """Results with the facts of a first run, which the service itself computes, and scores of their own."""
        if benchmark.name not in self._facts:
            self._facts[benchmark.name] = _computed_facts(session, benchmark, evaluations[0])
        facts = self._facts[benchmark.name]
        levels = self._generator.uniform(20, 90, len(evaluations))
        scores = np.clip(self._generator.normal(levels[:, None], 20, (len(levels), len(facts["values"]))), 0, 100)
        results = [
            _result(run, float(values.mean()), facts | {"values": values.tolist()})
            for run, values in zip(evaluations, scores, strict=True)
        ]
        session.execute(insert(Result), results)


def _add_agents(session: Session, kind: str, numbers: Sequence[int]) -> None:
    """Agents of one version, each of an owner who may have others."""
    agents = [{"id": f"ag-{kind}{n}", "name": f"{kind}{n}", "owner": f"owner{n % OWNERS}"} for n in numbers]
    facts = {"version": 1, "kind": AgentKind.BUILTIN, "track": "privileged", "info": {}}
    session.execute(insert(Agent), agents)
    session.execute(insert(Submission), [facts | {"id": f"su-{kind}{n}", "agent_id": f"ag-{kind}{n}"} for n in numbers])


def _copy_episodes(session: Session, pattern: str, ids: Sequence[str]) -> None:
    """Gives evaluations the episodes of another one, with identifiers and record hashes of their own."""
    if not ids:
        return
    same = ("position", "scenario", "cell", "seed", "status", "attempts", "kept_bytes", "summary")
    own = Evaluation.id + "-" + Episode.position.cast(String)
    copied = select(own, own, Evaluation.id, *(getattr(Episode, name) for name in same))
    copied = copied.join(Evaluation, Evaluation.id.in_(ids)).where(Episode.evaluation_id == pattern)
    session.execute(insert(Episode).from_select(["id", "record_hash", "evaluation_id", *same], copied))


def _add_attempts(session: Session, ids: Sequence[str]) -> None:
    """One attempt at each episode of evaluations; one in `EPISODES` counts against the agent."""
    facts = {
        "number": 1,
        "started": now(),
        "ended": now(),
        "outcome": AttemptOutcome.DONE,
        "processor_s": 10.0,
    }
    values = (literal(value, getattr(Attempt, name).type) for name, value in facts.items())
    made = select(Episode.id, Episode.id, Episode.position == 7, *values).where(Episode.evaluation_id.in_(ids))
    session.execute(insert(Attempt).from_select(["id", "episode_id", "charged", *facts], made))


def _computed_facts(session: Session, benchmark: Benchmark, run: dict[str, Any]) -> dict[str, Any]:
    """Facts of a run's result, as the service computes them from its episodes."""
    entry = entries(session, [run["id"]])[run["id"]]
    return facts_of(entry, benchmark.headline)


def _result(run: dict[str, Any], score: float, facts: dict[str, Any]) -> dict[str, Any]:
    return {
        "evaluation_id": run["id"],
        "ranking_id": run["ranking_id"],
        "entrant": run["submission_id"],
        "track": "privileged",
        "score": score,
        "ordered": run["created"],
        "finished": run["finished"],
        "facts": facts,
    }


def _drive(ego: str, score: float) -> dict[str, Any]:
    """A finished drive with one collision, as `dohyo.service.evaluations.scoring.summary_of` gives it."""
    return {
        "name": ego,
        "status": "completed",
        "success": True,
        "nocrash": False,
        "ds": score,
        "rc": 100.0,
        "ip": score / 100,
        "irs": score / 2,
        "road": 50.0,
        "drove": False,
        "infractions": {"collision_vehicle": 1},
        "marks": [{"kind": "collision_vehicle", "time_s": 12.3, "x_m": 1234.56, "y_m": 789.01, "route_m": 456.78}],
        "km": 1.0,
        "route_m": 1000.0,
        "driven_m": 1000.0,
        "duration_s": 120.0,
    }
