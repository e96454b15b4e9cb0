"""Evaluations and their episodes: queued, listed, counted, resumed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from types import MappingProxyType
from typing import Any

from sqlalchemy import ColumnElement, func, or_, select, update
from sqlalchemy.orm import Session

from dohyo.service.benchmarks.catalog import AnyBenchmark, AnyScenario
from dohyo.service.database.base import new_id, now
from dohyo.service.database.pages import newest_first
from dohyo.service.evaluations.model import (
    UNFINISHED,
    Attempt,
    BenchmarkVersion,
    Episode,
    EpisodeStatus,
    Evaluation,
    EvaluationEgo,
    EvaluationStatus,
)
from dohyo.service.submissions.model import Agent, Submission

AGAIN = (EpisodeStatus.LOST, EpisodeStatus.CANCELLED)

Counts = dict[EpisodeStatus, int]


def save_benchmark(session: Session, benchmark: AnyBenchmark) -> BenchmarkVersion:
    """The stored form of a benchmark as it is now."""
    version = session.get(BenchmarkVersion, benchmark.sha256)
    if version is None:
        document = benchmark.model_dump(mode="json")
        version = BenchmarkVersion(sha256=benchmark.sha256, name=benchmark.name, document=document)
        session.add(version)
        session.flush()
    return version


def add_evaluation(
    session: Session,
    owner: str,
    submission: Submission,
    benchmark: AnyBenchmark,
    seeds: Sequence[int],
    scenarios: Sequence[AnyScenario],
    *,
    slow_policy: str,
    act_deadline_s: float,
    ranking_id: str | None = None,
    team_id: str | None = None,
    others: Mapping[str, Submission] = MappingProxyType({}),
) -> Evaluation:
    """Queues an evaluation with all its episodes.

    Args:
        session: To write in.
        owner: Owner of the evaluation.
        submission: Submission that drives.
        benchmark: AnyBenchmark to drive.
        seeds: Of the benchmark's scenarios.
        scenarios: `benchmark.scenarios(seeds)`: an episode's position is its place in there.
        slow_policy: "wait" or "realtime".
        act_deadline_s: Wall-clock time for one decision.
        ranking_id: Ranking that the run enters; None in practice.
        team_id: Team that the run counts for; None outside of challenges.
        others: Submissions that drive single egos of a mixed run, by ego.
    """
    evaluation = Evaluation(
        id=new_id("ev"),
        owner=owner,
        submission_id=submission.id,
        benchmark_sha256=save_benchmark(session, benchmark).sha256,
        ranking_id=ranking_id,
        team_id=team_id,
        seeds=list(seeds),
        status=EvaluationStatus.QUEUED,
        slow_policy=slow_policy,
        act_deadline_s=act_deadline_s,
        egos=[EvaluationEgo(ego=ego, submission_id=other.id) for ego, other in others.items()],
    )
    session.add(evaluation)
    session.flush()
    session.add_all(
        Episode(
            id=new_id("ep"),
            evaluation_id=evaluation.id,
            position=position,
            scenario=scenario.name,
            cell=scenario.cell,
            seed=scenario.seed,
        )
        for position, scenario in enumerate(scenarios)
    )
    session.flush()
    return evaluation


def count_unfinished(session: Session, owner: str) -> int:
    """Number of an owner's unfinished evaluations."""
    query = select(func.count()).select_from(Evaluation)
    return session.scalar(query.where(Evaluation.owner == owner, Evaluation.status.in_(UNFINISHED))) or 0


def count_waiting(session: Session, owner: str | None = None) -> int:
    """Number of queued episodes of an owner; None: over all owners."""
    query = select(func.count()).select_from(Episode).join(Evaluation, Evaluation.id == Episode.evaluation_id)
    waiting = query.where(Episode.status == EpisodeStatus.QUEUED, Evaluation.status.in_(UNFINISHED))
    return session.scalar(waiting if owner is None else waiting.where(Evaluation.owner == owner)) or 0


def count_missing(session: Session, evaluation: Evaluation) -> int:
    """Number of an evaluation's episodes that `resume` would queue again."""
    query = select(func.count()).where(Episode.evaluation_id == evaluation.id, Episode.status.in_(AGAIN))
    return session.scalar(query) or 0


def list_evaluations(
    session: Session,
    seen: ColumnElement[bool],
    *,
    agent: str | None = None,
    benchmark: str | None = None,
    status: EvaluationStatus | None = None,
    ranking: str | None = None,
    limit: int | None = None,
    after: str | None = None,
) -> Sequence[Evaluation]:
    """Evaluations, the newest first, those older than `after`.

    Args:
        session: To read in.
        seen: Condition that all must meet, see `dohyo.service.evaluations.access.seen_by`.
        agent: Only evaluations in which the agent of this name drives, be it a single ego of a mixed run.
        benchmark: Only evaluations on versions of the benchmark of this name.
        status: Only evaluations of this status.
        ranking: Only runs of the ranking of this identifier.
        limit: Largest number of results.
        after: Identifier of an evaluation; an unknown one gives none.
    """
    query = newest_first(session, select(Evaluation).where(seen), Evaluation, limit, after)
    if agent is not None:
        own = select(Submission.id).join(Agent, Agent.id == Submission.agent_id).where(Agent.name == agent)
        mixed = select(EvaluationEgo.evaluation_id).where(EvaluationEgo.submission_id.in_(own))
        query = query.where(or_(Evaluation.submission_id.in_(own), Evaluation.id.in_(mixed)))
    if benchmark is not None:
        query = query.join(BenchmarkVersion, BenchmarkVersion.sha256 == Evaluation.benchmark_sha256)
        query = query.where(BenchmarkVersion.name == benchmark)
    if status is not None:
        query = query.where(Evaluation.status == status)
    if ranking is not None:
        query = query.where(Evaluation.ranking_id == ranking)
    return session.scalars(query).unique().all()


def count_episodes(session: Session, evaluation_ids: Iterable[str]) -> Mapping[str, Counts]:
    """Episodes by status, for each evaluation."""
    ids = list(evaluation_ids)
    counts: dict[str, Counts] = {one: {} for one in ids}
    query = select(Episode.evaluation_id, Episode.status, func.count()).where(Episode.evaluation_id.in_(ids))
    for evaluation_id, status, count in session.execute(query.group_by(Episode.evaluation_id, Episode.status)):
        counts[evaluation_id][status] = count
    return counts


def names_of(session: Session, evaluations: Sequence[Evaluation]) -> Mapping[str, tuple[str, str]]:
    """Names of the agent and the benchmark, for each evaluation."""
    query = (
        select(Evaluation.id, Agent.name, BenchmarkVersion.name)
        .join(Submission, Submission.id == Evaluation.submission_id)
        .join(Agent, Agent.id == Submission.agent_id)
        .join(BenchmarkVersion, BenchmarkVersion.sha256 == Evaluation.benchmark_sha256)
        .where(Evaluation.id.in_([one.id for one in evaluations]))
    )
    return {evaluation_id: (agent, benchmark) for evaluation_id, agent, benchmark in session.execute(query)}


def count_by_version(session: Session, benchmark: str) -> Sequence[tuple[str, datetime, int]]:
    """Versions of a benchmark that were evaluated, the newest first: hash, when first, how often."""
    query = (
        select(BenchmarkVersion.sha256, BenchmarkVersion.created, func.count(Evaluation.id))
        .outerjoin(Evaluation, Evaluation.benchmark_sha256 == BenchmarkVersion.sha256)
        .where(BenchmarkVersion.name == benchmark)
        .group_by(BenchmarkVersion.sha256, BenchmarkVersion.created)
        .order_by(BenchmarkVersion.created.desc())
    )
    return [(sha256, created, count) for sha256, created, count in session.execute(query)]


def list_attempts(session: Session, episode_id: str, *, limit: int, after: int = 0) -> Sequence[Attempt]:
    """Attempts of an episode in the order of their starts, those past number `after`."""
    query = select(Attempt).where(Attempt.episode_id == episode_id, Attempt.number > after)
    return session.scalars(query.order_by(Attempt.number).limit(limit)).all()


def list_episodes(
    session: Session,
    evaluation_id: str,
    *,
    statuses: Sequence[EpisodeStatus] = tuple(EpisodeStatus),
    limit: int | None = None,
    after: int | None = None,
) -> Sequence[Episode]:
    """Episodes of an evaluation in the benchmark's order, those past position `after`."""
    query = select(Episode).where(Episode.evaluation_id == evaluation_id).order_by(Episode.position).limit(limit)
    if len(statuses) < len(EpisodeStatus):
        query = query.where(Episode.status.in_(statuses))
    if after is not None:
        query = query.where(Episode.position > after)
    return session.scalars(query).all()


def resume(session: Session, evaluation: Evaluation) -> int:
    """Queues lost and cancelled episodes again; finished ones are kept, and so are all attempts.

    Returns:
        How many episodes were queued.
    """
    fresh: dict[str, Any] = {
        "status": EpisodeStatus.QUEUED,
        "failure": None,
        "record_hash": None,
        "summary": None,
        "started": None,
        "finished": None,
    }
    again = (Episode.evaluation_id == evaluation.id, Episode.status.in_(AGAIN))
    lost = session.scalars(select(Episode.id).where(*again)).all()
    session.execute(update(Episode).where(*again).values(fresh))
    evaluation.status, evaluation.failure, evaluation.finished = EvaluationStatus.QUEUED, None, None
    evaluation.announced = None  # its next end is another one, also where the clock was set back meanwhile
    session.flush()
    return len(lost)


def mark_announced(session: Session, evaluation: Evaluation) -> None:
    """Marks the end of an evaluation as announced to webhooks."""
    evaluation.announced = evaluation.finished or now()
