"""Read-only queries: evaluations, their episodes, and the entries of comparisons and metrics."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, String, cast, exists, func, select
from sqlalchemy.orm import Session

from dohyo.service.boards.leaderboard import Driver, Entry
from dohyo.service.evaluations.model import (
    BenchmarkVersion,
    Episode,
    EpisodeStatus,
    Evaluation,
    EvaluationEgo,
    EvaluationStatus,
    is_lost,
)
from dohyo.service.evaluations.scoring import Drive
from dohyo.service.submissions.model import Agent, Submission


def find_episode(session: Session, episode_id: str, seen: ColumnElement[bool]) -> tuple[Episode, Evaluation] | None:
    """An episode by its id with its evaluation, if it exists and its evaluation meets a condition."""
    query = select(Episode, Evaluation).join(Evaluation).where(Episode.id == episode_id, seen)
    row = session.execute(query).unique().one_or_none()
    return (row[0], row[1]) if row else None


def recorded_episodes(session: Session, evaluation_id: str) -> list[Episode]:
    """Episodes of an evaluation with a record, in the benchmark's order."""
    query = select(Episode).where(Episode.evaluation_id == evaluation_id, Episode.status == EpisodeStatus.DONE)
    return list(session.scalars(query.where(Episode.record_hash.is_not(None)).order_by(Episode.position)))


@dataclass(frozen=True, slots=True)
class Ordered:
    """A run that was ordered, whatever became of it.

    Attributes:
        number: Of the order, see `Evaluation`.
        dohyo_versions: Versions of dohyo that have driven some of it.
    """

    number: int
    dohyo_versions: frozenset[str]

    def comes_before(self, other: Ordered) -> bool:
        """Whether it was ordered first, and no version of dohyo has driven it that did not drive the other, too.

        After an upgrade the runs of before can have no rank, so that the first order of those that follow counts.
        """
        return self.number < other.number and self.dohyo_versions <= other.dohyo_versions


def orders_by_runner(session: Session, ranking_id: str) -> dict[str, list[Ordered]]:
    """All runs of a ranking by the team, else the submission, that they were ordered for."""
    runner = func.coalesce(Evaluation.team_id, Evaluation.submission_id)
    query = select(runner, Evaluation.number, Evaluation.dohyo_versions).where(Evaluation.ranking_id == ranking_id)
    found: dict[str, list[Ordered]] = {}
    for one, number, versions in session.execute(query):
        found.setdefault(one, []).append(Ordered(number, frozenset(versions)))
    return found


def benchmark_versions(session: Session, name: str) -> list[BenchmarkVersion]:
    """All evaluated versions of a benchmark, newest first."""
    query = select(BenchmarkVersion).where(BenchmarkVersion.name == name)
    return list(session.scalars(query.order_by(BenchmarkVersion.created.desc(), BenchmarkVersion.sha256)))


def benchmark_names(session: Session) -> list[str]:
    """Names of all evaluated benchmarks, sorted."""
    return sorted(session.scalars(select(BenchmarkVersion.name).distinct()))


def mixed_runs_by_version(session: Session, benchmark_sha256: str, seen: ColumnElement[bool]) -> dict[str | None, int]:
    """Number of complete mixed runs that meet a condition, by the version of dohyo that drove them; None: several."""
    # The column is JSON, which PostgreSQL neither compares nor groups.
    versions = cast(Evaluation.dohyo_versions, String)
    query = select(versions, func.count()).where(_complete(benchmark_sha256), seen, _is_mixed()).group_by(versions)
    found: Counter[str | None] = Counter()
    for text, count in session.execute(query):
        several = len(noted := json.loads(text)) != 1
        found[None if several else noted[0]] += count
    return found


def mixed_runs(
    session: Session, benchmark_sha256: str, dohyo: str | None, seen: ColumnElement[bool], limit: int
) -> list[str]:
    """Complete mixed runs on a benchmark version by one version of dohyo; of owners in turn, the newest first.

    Args:
        session: To read in.
        benchmark_sha256: The benchmark's version.
        dohyo: Version of dohyo that drove all of a run.
        seen: Condition on `Evaluation`.
        limit: Most runs.
    """
    return _complete_runs(session, benchmark_sha256, dohyo, seen & _is_mixed(), limit)


def runs_alone(
    session: Session,
    benchmark_sha256: str,
    dohyo: str | None,
    submissions: Collection[str],
    seen: ColumnElement[bool],
    limit: int,
) -> list[str]:
    """The same of runs of some submissions without other agents."""
    of_those = Evaluation.submission_id.in_(submissions)
    return _complete_runs(session, benchmark_sha256, dohyo, seen & ~_is_mixed() & of_those, limit)


def _complete_runs(
    session: Session, benchmark_sha256: str, dohyo: str | None, which: ColumnElement[bool], limit: int
) -> list[str]:
    by_one = cast(Evaluation.dohyo_versions, String) == json.dumps([dohyo])
    newest = Evaluation.created.desc()
    turn = func.row_number().over(partition_by=Evaluation.owner, order_by=newest)  # one owner cannot fill the limit
    query = (
        select(Evaluation.id).where(_complete(benchmark_sha256), by_one, which).order_by(turn, newest, Evaluation.id)
    )
    return list(session.scalars(query.limit(limit)))


def _complete(benchmark_sha256: str) -> ColumnElement[bool]:
    return (Evaluation.benchmark_sha256 == benchmark_sha256) & (Evaluation.status == EvaluationStatus.DONE)


def _is_mixed() -> ColumnElement[bool]:
    return exists().where(EvaluationEgo.evaluation_id == Evaluation.id)


def entries(session: Session, evaluation_ids: Sequence[str]) -> dict[str, Entry]:
    """Evaluations by id, with finished drives and the number of lost ones; unknown ids give no entry."""
    query = (
        select(Evaluation.id, Evaluation.seeds, Evaluation.finished, Evaluation.dohyo_versions, Agent.owner)
        .add_columns(Submission.id, Submission.version, Submission.kind, Submission.track, Agent.name)
        .add_columns(BenchmarkVersion.name, BenchmarkVersion.sha256)
        .select_from(Evaluation)
        .join(Submission, Submission.id == Evaluation.submission_id)
        .join(Agent, Agent.id == Submission.agent_id)
        .join(BenchmarkVersion, BenchmarkVersion.sha256 == Evaluation.benchmark_sha256)
        .where(Evaluation.id.in_(evaluation_ids))
    )
    drives, gridlocked = _drives(session, evaluation_ids)
    lost = _lost_drives(session, evaluation_ids, gridlocked)
    others = _others(session, evaluation_ids)
    found: dict[str, Entry] = {}
    for one, seeds, finished, dohyo_versions, owner, *submitted, benchmark, sha256 in session.execute(query):
        submission, version, kind, track, agent = submitted
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
            lost={cell: sum(egos.values()) for cell, egos in lost.get(one, {}).items()},
            lost_egos=sum(lost.get(one, {}).values(), Counter[str]()),
            gridlocked=tuple(gridlocked.get(one, ())),
            others=others.get(one, {}),
            dohyo_versions=tuple(dohyo_versions),
        )
    return found


def unrecorded_drives(session: Session, evaluation_id: str) -> dict[str, int]:
    """Number of an evaluation's drives that were lost without a record, by cell."""
    lost = _lost_drives(session, [evaluation_id], {}).get(evaluation_id, {})
    return {cell: sum(egos.values()) for cell, egos in lost.items()}


def driver_of(submission: Submission) -> Driver:
    """A submission as a driver."""
    agent = submission.agent
    return Driver(submission.id, agent.name, submission.version, agent.owner, submission.kind.value, submission.track)


def count_by_status(session: Session) -> tuple[Mapping[str, int], Mapping[str, int]]:
    """Number of episodes, and of evaluations, by status."""
    episodes = session.execute(select(Episode.status, func.count()).group_by(Episode.status))
    evaluations = session.execute(select(Evaluation.status, func.count()).group_by(Evaluation.status))
    return {status.value: count for status, count in episodes}, {status.value: count for status, count in evaluations}


def _drives(session: Session, evaluation_ids: Sequence[str]) -> tuple[dict[str, list[Drive]], dict[str, list[Drive]]]:
    """Drives with a record, by evaluation: those that count, and those of gridlocked episodes."""
    query = (
        select(Episode.evaluation_id, Episode.id, Episode.scenario, Episode.cell, Episode.seed, Episode.summary)
        .add_columns(Episode.record_hash)
        .where(Episode.evaluation_id.in_(evaluation_ids), Episode.status == EpisodeStatus.DONE)
        .order_by(Episode.evaluation_id, Episode.position)
    )
    drives: dict[str, list[Drive]] = {}
    gridlocked: dict[str, list[Drive]] = {}
    for evaluation_id, episode_id, scenario, cell, seed, summary, record_hash in session.execute(query):
        side = gridlocked if is_lost(summary) else drives
        side.setdefault(evaluation_id, []).extend(
            Drive(episode_id, scenario, cell, seed, facts, record_hash) for facts in (summary or {}).get("egos", ())
        )
    return drives, gridlocked


def _others(session: Session, evaluation_ids: Sequence[str]) -> dict[str, dict[str, Driver]]:
    """Drivers of single egos, by mixed run and ego."""
    query = select(EvaluationEgo).where(EvaluationEgo.evaluation_id.in_(evaluation_ids))
    found: dict[str, dict[str, Driver]] = {}
    for one in session.scalars(query.order_by(EvaluationEgo.evaluation_id, EvaluationEgo.ego)):
        found.setdefault(one.evaluation_id, {})[one.ego] = driver_of(one.submission)
    return found


def _lost_drives(
    session: Session, evaluation_ids: Sequence[str], gridlocked: Mapping[str, Sequence[Drive]]
) -> dict[str, dict[str, Counter[str]]]:
    """Number of drives in lost episodes, without a record or gridlocked, by evaluation, cell and ego."""
    query = (
        select(Episode.evaluation_id, Episode.cell, func.count(), BenchmarkVersion.sha256)
        .join(Evaluation, Evaluation.id == Episode.evaluation_id)
        .join(BenchmarkVersion, BenchmarkVersion.sha256 == Evaluation.benchmark_sha256)
        .where(Episode.evaluation_id.in_(evaluation_ids), Episode.status == EpisodeStatus.LOST)
        .group_by(Episode.evaluation_id, Episode.cell, BenchmarkVersion.sha256)
    )
    found: dict[str, dict[str, Counter[str]]] = {}
    for evaluation_id, cell, episodes, sha256 in session.execute(query):
        document = session.get_one(BenchmarkVersion, sha256).document
        found.setdefault(evaluation_id, {})[cell] = Counter(dict.fromkeys(_egos(document, cell), episodes))
    for evaluation_id, drives in gridlocked.items():
        for drive in drives:
            found.setdefault(evaluation_id, {}).setdefault(drive.cell, Counter())[drive.ego] += 1
    return found


def _egos(document: Mapping[str, Any], cell: str) -> list[str]:
    """Egos in each episode of a benchmark's cell; one that drives alone is "ego"."""
    for one in document.get("cells", ()):
        if one["name"] == cell and one.get("together"):
            return [mission["name"] for mission in document["missions"][one["missions"]]]
    return ["ego"]
