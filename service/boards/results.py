"""Results: scores of complete ranked runs, computed once and stored, so that a board of thousands is read quickly."""

from __future__ import annotations

from dataclasses import asdict
from statistics import fmean
from typing import Any, Final

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session

from dohyo.service.boards.leaderboard import Entry
from dohyo.service.boards.model import Ranking, Result
from dohyo.service.boards.queries import entries
from dohyo.service.database.engine import serialise
from dohyo.service.evaluations.model import Evaluation, EvaluationStatus
from dohyo.service.evaluations.scoring import by_episode, rank_sign

AT_ONCE: Final = 50


def complete(ranking: Ranking) -> ColumnElement[bool]:
    """Condition on `Evaluation`: a complete run of a ranking, ended in time."""
    condition = (Evaluation.ranking_id == ranking.id) & (Evaluation.status == EvaluationStatus.DONE)
    return condition if ranking.ends is None else condition & (Evaluation.finished <= ranking.ends)


def is_behind(session: Session, ranking: Ranking) -> bool:
    """Whether a complete run has no stored result yet."""
    runs = session.scalar(select(func.count()).select_from(Evaluation).where(complete(ranking)))
    stored = session.scalar(select(func.count()).select_from(Result).where(Result.ranking_id == ranking.id))
    return runs != stored


def store_results(session: Session, ranking: Ranking, headline: str) -> None:
    """Stores the results of all complete runs that have none yet.

    Args:
        session: To write in.
        ranking: The ranking.
        headline: Score that ranks on its benchmark.
    """
    serialise(session)
    query = select(Evaluation.id).outerjoin(Result, Result.evaluation_id == Evaluation.id)
    missing = session.scalars(query.where(complete(ranking), Result.evaluation_id.is_(None))).all()
    for start in range(0, len(missing), AT_ONCE):
        some = missing[start : start + AT_ONCE]
        runs = {one.id: one for one in session.scalars(select(Evaluation).where(Evaluation.id.in_(some))).unique()}
        for identifier, entry in entries(session, some).items():
            session.add(_result(runs[identifier], entry, headline))
        session.flush()


def facts_of(entry: Entry, headline: str) -> dict[str, Any]:
    """The facts of a stored result: what a board shows of a run, and the values that it is compared by."""
    return {
        "scores": {name: asdict(score) for name, score in entry.scores.items()},
        "per_km": entry.per_km,
        "episodes": len({drive.episode for drive in entry.drives}),
        "drives": len(entry.drives),
        "lost": sum(entry.lost.values()),
        "low_throughput": entry.low_throughput,
        "values": _values(entry, headline) if entry.drives and headline in entry.scores else [],
    }


def _values(entry: Entry, headline: str) -> list[float | None]:
    """Mean score of the egos of each episode, in the order of scenarios and seeds, so that runs pair by episodes.

    None holds the place of a lost episode.

    Args:
        entry: A complete run: each of its lost drives has a record.
        headline: Score that ranks, which all drives that count have.
    """
    values = {
        drives[0].key[:2]: rank_sign(headline) * fmean(drive.score(headline) for drive in drives)
        for drives in by_episode(entry.drives)
    }
    return [values.get(key) for key in sorted({*values, *(drive.key[:2] for drive in entry.gridlocked)})]


def _result(run: Evaluation, entry: Entry, headline: str) -> Result:
    return Result(
        evaluation_id=run.id,
        ranking_id=run.ranking_id,
        entrant=run.team_id or run.submission_id,
        track=entry.track,
        score=rank_sign(headline) * (entry.scores[headline].mean or 0.0) if headline in entry.scores else 0.0,
        finished=run.finished,
        facts=facts_of(entry, headline),
    )
