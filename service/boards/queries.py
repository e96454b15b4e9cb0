"""Read-only queries: evaluations, their episodes, and the entries of comparisons and metrics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session

from dohyo.service.boards.leaderboard import Entry
from dohyo.service.evaluations.model import BenchmarkVersion, Episode, EpisodeStatus, Evaluation
from dohyo.service.evaluations.scoring import Drive
from dohyo.service.submissions.model import Agent, Submission


def find_episode(session: Session, episode_id: str, seen: ColumnElement[bool]) -> tuple[Episode, Evaluation] | None:
    """An episode by its id with its evaluation, if it exists and its evaluation meets a condition."""
    query = select(Episode, Evaluation).join(Evaluation).where(Episode.id == episode_id, seen)
    row = session.execute(query).unique().one_or_none()
    return (row[0], row[1]) if row else None


def recorded_episodes(session: Session, evaluation_id: str) -> list[Episode]:
    """Episodes of an evaluation with a record that counts, in the benchmark's order."""
    query = select(Episode).where(Episode.evaluation_id == evaluation_id, Episode.status == EpisodeStatus.DONE)
    return list(session.scalars(query.where(Episode.record_hash.is_not(None)).order_by(Episode.position)))


def first_orders(session: Session, ranking_id: str) -> dict[str, datetime]:
    """Time of the first order of each entrant of a ranking, whatever became of that run."""
    entrant = func.coalesce(Evaluation.team_id, Evaluation.submission_id)
    query = select(entrant, func.min(Evaluation.created)).where(Evaluation.ranking_id == ranking_id).group_by(entrant)
    return {row[0]: row[1] for row in session.execute(query)}


def benchmark_versions(session: Session, name: str) -> list[BenchmarkVersion]:
    """All evaluated versions of a benchmark, newest first."""
    query = select(BenchmarkVersion).where(BenchmarkVersion.name == name)
    return list(session.scalars(query.order_by(BenchmarkVersion.created.desc(), BenchmarkVersion.sha256)))


def benchmark_names(session: Session) -> list[str]:
    """Names of all evaluated benchmarks, sorted."""
    return sorted(session.scalars(select(BenchmarkVersion.name).distinct()))


def entries(session: Session, evaluation_ids: Sequence[str]) -> dict[str, Entry]:
    """Evaluations by id, with finished drives and the number of lost ones; unknown ids give no entry."""
    query = (
        select(Evaluation.id, Evaluation.seeds, Evaluation.finished, Evaluation.owner)
        .add_columns(Submission.id, Submission.version, Submission.kind, Submission.track, Agent.name)
        .add_columns(BenchmarkVersion.name, BenchmarkVersion.sha256)
        .select_from(Evaluation)
        .join(Submission, Submission.id == Evaluation.submission_id)
        .join(Agent, Agent.id == Submission.agent_id)
        .join(BenchmarkVersion, BenchmarkVersion.sha256 == Evaluation.benchmark_sha256)
        .where(Evaluation.id.in_(evaluation_ids))
    )
    drives, lost = _drives(session, evaluation_ids), _lost_drives(session, evaluation_ids)
    found: dict[str, Entry] = {}
    for one, seeds, finished, owner, submission, version, kind, track, agent, benchmark, sha256 in session.execute(
        query
    ):
        found[one] = Entry(
            evaluation=one,
            submission=submission,
            agent=agent,
            version=version,
            owner=owner,
            kind=kind.value,
            track=track,
            benchmark=benchmark,
            benchmark_sha256=sha256,
            seeds=tuple(seeds),
            finished=finished,
            drives=tuple(drives.get(one, ())),
            lost=lost.get(one, {}),
        )
    return found


def count_by_status(session: Session) -> tuple[Mapping[str, int], Mapping[str, int]]:
    """Number of episodes, and of evaluations, by status."""
    episodes = session.execute(select(Episode.status, func.count()).group_by(Episode.status))
    evaluations = session.execute(select(Evaluation.status, func.count()).group_by(Evaluation.status))
    return {status.value: count for status, count in episodes}, {status.value: count for status, count in evaluations}


def _drives(session: Session, evaluation_ids: Sequence[str]) -> dict[str, list[Drive]]:
    query = (
        select(Episode.evaluation_id, Episode.id, Episode.scenario, Episode.cell, Episode.seed, Episode.summary)
        .where(Episode.evaluation_id.in_(evaluation_ids), Episode.status == EpisodeStatus.DONE)
        .order_by(Episode.evaluation_id, Episode.position)
    )
    drives: dict[str, list[Drive]] = {}
    for evaluation_id, episode_id, scenario, cell, seed, summary in session.execute(query):
        drives.setdefault(evaluation_id, []).extend(
            Drive(episode_id, scenario, cell, seed, facts) for facts in (summary or {}).get("egos", ())
        )
    return drives


def _lost_drives(session: Session, evaluation_ids: Sequence[str]) -> dict[str, dict[str, int]]:
    """Number of drives in lost episodes, by evaluation and cell."""
    query = (
        select(Episode.evaluation_id, Episode.cell, func.count(), BenchmarkVersion.sha256)
        .join(Evaluation, Evaluation.id == Episode.evaluation_id)
        .join(BenchmarkVersion, BenchmarkVersion.sha256 == Evaluation.benchmark_sha256)
        .where(Episode.evaluation_id.in_(evaluation_ids), Episode.status == EpisodeStatus.LOST)
        .group_by(Episode.evaluation_id, Episode.cell, BenchmarkVersion.sha256)
    )
    found: dict[str, dict[str, int]] = {}
    for evaluation_id, cell, episodes, sha256 in session.execute(query):
        document = session.get_one(BenchmarkVersion, sha256).document
        found.setdefault(evaluation_id, {})[cell] = episodes * _egos(document, cell)
    return found


def _egos(document: Mapping[str, Any], cell: str) -> int:
    """Number of egos in each episode of a benchmark's cell."""
    for one in document.get("cells", ()):
        if one["name"] == cell and one.get("together"):
            return len(document["missions"][one["missions"]])
    return 1
