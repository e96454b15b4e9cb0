"""Standings: the places of each ranking, kept in memory, since complete runs never change."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Final, Generic, TypeVar

import numpy as np
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from dohyo.service.boards.leaderboard import Contender, Place, Ranks, places_of
from dohyo.service.boards.model import Counts, Ranking, Result
from dohyo.service.boards.queries import Ordered, orders_by_runner
from dohyo.service.boards.results import is_behind, store_results
from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import Evaluation
from dohyo.service.submissions.model import Submission

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")

RANKINGS: Final = 50


@dataclass(slots=True)
class Recent(Generic[K, V]):
    """Cache of the `size` most recently used values."""

    size: int
    values: OrderedDict[K, V] = field(default_factory=OrderedDict)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def get(self, key: K) -> V | None:
        """The value, or None."""
        with self.lock:
            if key in self.values:
                self.values.move_to_end(key)
            return self.values.get(key)

    def put(self, key: K, value: V) -> None:
        """Stores a value and drops the least recently used one."""
        with self.lock:
            self.values[key] = value
            self.values.move_to_end(key)
            while len(self.values) > self.size:
                self.values.popitem(last=False)

    def get_or_make(self, key: K, make: Callable[[], V]) -> V:
        """The value, made where there is none."""
        with self.lock:
            if key not in self.values:
                self.values[key] = make()
            self.values.move_to_end(key)
            while len(self.values) > self.size:
                self.values.popitem(last=False)
            return self.values[key]


@dataclass(slots=True)
class _Standing:
    """One ranking in memory.

    Attributes:
        runs: Complete runs by evaluation, without those that `Counts` leaves out.
        state: Number of stored results and the latest end among them, when the runs were read.
        places: Places by track, and by the runs that one reader may see; emptied when the runs change.
        ranks: Verdicts.
        lock: Held while the runs are read and ranked; other readers wait for that result.
    """

    runs: dict[str, Contender] = field(default_factory=dict)
    state: tuple[object, ...] = ()
    places: Recent[tuple[str | None, frozenset[str] | None], list[Place]] = field(default_factory=lambda: Recent(20))
    ranks: Ranks = field(default_factory=Ranks)
    lock: threading.Lock = field(default_factory=threading.Lock)


class Standings:
    """Places of rankings."""

    def __init__(self) -> None:
        self._standings: Recent[str, _Standing] = Recent(RANKINGS)

    def places(
        self,
        database: Database,
        ranking: Ranking,
        headline: str,
        *,
        track: str | None = None,
        only: frozenset[str] | None = None,
    ) -> list[Place]:
        """The current places of a ranking; stores results of runs that are new.

        Args:
            database: Database of the service.
            ranking: The ranking.
            headline: Score that ranks on its benchmark.
            track: Only runs on this track; they are ranked among themselves.
            only: Only these evaluations, such as those that one reader may see; None: all.
        """
        with database.reading() as session:
            behind = is_behind(session, ranking)
        if behind:
            with database.session() as session:
                store_results(session, ranking, headline)
        standing = self._standings.get_or_make(ranking.id, _Standing)
        with standing.lock, database.reading() as session:
            _refresh(session, standing, ranking)
            key = (track, only)
            places = standing.places.get(key)
            if places is None:
                runs = [
                    run
                    for run in standing.runs.values()
                    if (track is None or run.track == track) and (only is None or run.evaluation in only)
                ]
                places = standing.ranks.rank(places_of(runs))
                standing.places.put(key, places)
            return places


def _refresh(session: Session, standing: _Standing, ranking: Ranking) -> None:
    """Reads new results, and forgets deleted ones."""
    mine = Result.ranking_id == ranking.id
    state = tuple(session.execute(select(func.count(), func.max(Result.finished)).where(mine)).one())
    if state == standing.state:
        return
    known = set(session.scalars(select(Result.evaluation_id).where(mine)))
    standing.runs = {one: run for one, run in standing.runs.items() if one in known}
    needed = (Result.evaluation_id, Result.entrant, Result.track, Result.score, Evaluation.number)
    facts = (Result.facts["values"], Result.facts["low_throughput"])
    new = select(*needed, *facts, Evaluation.team_id, Submission.agent_id, Evaluation.dohyo_versions).where(mine)
    new = new.join(Evaluation, Evaluation.id == Result.evaluation_id)
    new = new.join(Submission, Submission.id == Evaluation.submission_id)
    if standing.runs:
        new = new.where(Result.evaluation_id.in_(known - standing.runs.keys()))
    # A run that was ordered first and cancelled leaves its place empty: nobody must choose among runs.
    orders = orders_by_runner(session, ranking.id) if ranking.counts is Counts.FIRST else {}
    is_open = ranking.challenge_id is None
    for run, runner, track, score, number, values, low, team, agent, versions in session.execute(new):
        own = Ordered(number, frozenset(versions))
        if values and not any(one.comes_before(own) for one in orders.get(runner, ())):
            entrant, baseline = agent if is_open else runner, not is_open and team is None
            array = np.array(values, dtype=np.float64)  # None becomes NaN
            kept = (run, entrant, baseline, track, score, number, tuple(versions), array)
            standing.runs[run] = Contender(*kept, low_throughput=bool(low))
    standing.state = state
    standing.places = Recent(20)
