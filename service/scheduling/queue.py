"""The queue of episodes in the database. Each function is one small transaction.

A change of an episode names its attempt, which must be the latest, and the episode must be running. A late change, such
as the record of an episode that was cancelled meanwhile, or of one that is driven again, therefore has no effect, and
no episode is counted twice.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import closing
from dataclasses import dataclass
from enum import Enum
from typing import Any

from sqlalchemy import ColumnElement, exists, func, select, update
from sqlalchemy.orm import Session

from dohyo.service.boards.model import Ranking
from dohyo.service.database.base import now
from dohyo.service.evaluations.model import (
    UNFINISHED,
    Attempt,
    AttemptOutcome,
    Episode,
    EpisodeStatus,
    Evaluation,
    EvaluationStatus,
    is_lost,
)
from dohyo.service.evaluations.versions import note_version
from dohyo.service.running.order import agent_seed
from dohyo.service.scheduling import attempts
from dohyo.service.scheduling.attempts import LEAVING, UNCOUNTED, AttemptEnd, AttemptKey
from dohyo.service.submissions.model import AgentKind, Submission

LONGEST_FAILURE = 2000
NO_SCORE = "all episodes were lost to gridlocks, which follow from their seeds: the run has no score, and no place"


@dataclass(frozen=True, slots=True)
class Waiting:
    """An evaluation with queued episodes, oldest first.

    Attributes:
        evaluation_id: Identifier of the evaluation.
        owner: Owner of the evaluation.
        kind: Kind of the submission.
        agent: Name of the agent.
        version: Version of the submission.
    """

    evaluation_id: str
    owner: str
    kind: AgentKind
    agent: str
    version: int


@dataclass(frozen=True, slots=True)
class Ticket:
    """An episode taken from the queue.

    Attributes:
        key: Key of the attempt.
        waiting: Evaluation of the episode.
        position: Position in the benchmark's scenarios.
        stem: File name of its record, without suffix.
        attempt: Number of the attempt, from 1, without those that were not counted.
        used_up: Whether earlier attempts have used up those of the submission.
        info: AgentInfo of the submission, as a document.
        others: The same of the submissions that drive single egos of a mixed run, by ego.
        benchmark: Name and content hash of the benchmark.
        document: Document of the benchmark.
        seeds: Seeds of the evaluation.
        slow_policy: See `EpisodeOrder`.
        act_deadline_s: See `EpisodeOrder`.
        agent_seed: See `EpisodeOrder`.
    """

    key: AttemptKey
    waiting: Waiting
    position: int
    stem: str
    attempt: int
    used_up: bool
    info: dict[str, Any]
    others: dict[str, dict[str, Any]]
    benchmark: tuple[str, str]
    document: dict[str, Any]
    seeds: tuple[int, ...]
    slow_policy: str
    act_deadline_s: float
    agent_seed: int

    @property
    def episode_id(self) -> str:
        """Identifier of the episode."""
        return self.key.episode_id

    @property
    def evaluation_id(self) -> str:
        """Identifier of the evaluation."""
        return self.waiting.evaluation_id


class Next(Enum):
    """What follows on an attempt without a record; NOTHING: the episode no longer runs."""

    AGAIN = "again"
    LOST = "lost"
    AGENT_FAULT = "agent_fault"
    NOTHING = "nothing"


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of an evaluation.

    Attributes:
        evaluation_id: Identifier of the evaluation.
        status: Current status.
        done: Number of episodes with a record.
        total: Number of all episodes.
        ended: Whether this change ended it.
    """

    evaluation_id: str
    status: EvaluationStatus
    done: int
    total: int
    ended: bool = False


def waiting(session: Session, live: Collection[str] = ()) -> list[Waiting]:
    """All evaluations with queued episodes, oldest first; `live` is that of `take`."""
    queued = exists().where(Episode.evaluation_id == Evaluation.id, *_free(live))
    found = session.scalars(
        select(Evaluation).where(Evaluation.status.in_(UNFINISHED), queued).order_by(Evaluation.created, Evaluation.id)
    )
    return [_waiting(one) for one in found]


def queued_count(session: Session) -> int:
    """Number of queued episodes of unfinished evaluations."""
    query = select(func.count()).select_from(Episode).join(Evaluation)
    return session.scalar(query.where(Episode.status == EpisodeStatus.QUEUED, Evaluation.status.in_(UNFINISHED))) or 0


def take(session: Session, chosen: Waiting, live: Collection[str] = ()) -> Ticket | None:
    """Takes the next episode of an evaluation and begins an attempt; None: the queue is empty.

    Episodes of a remote agent come in a random order, so that their order tells a worker nothing.

    Args:
        session: Session to write in.
        chosen: The evaluation.
        live: Identifiers of episodes that are not taken, since the drive of an earlier attempt has not ended yet.
    """
    evaluation = _hold(session, chosen.evaluation_id)
    if evaluation is None or evaluation.status not in UNFINISHED:
        return None
    query = select(Episode).where(Episode.evaluation_id == evaluation.id, *_free(live))
    order = func.random() if chosen.kind is AgentKind.REMOTE else Episode.position
    episode = session.scalars(query.order_by(order).limit(1)).first()
    if episode is None:
        return None
    episode.status, episode.attempts, episode.started = EpisodeStatus.RUNNING, episode.attempts + 1, now()
    key = attempts.begin(session, episode)
    if evaluation.status is EvaluationStatus.QUEUED:
        evaluation.status, evaluation.started = EvaluationStatus.RUNNING, evaluation.started or now()
    return _ticket(episode, key, chosen, attempts.tally(session, episode.id).used_up)


def undriven(session: Session, live: Collection[str] = ()) -> list[AttemptKey]:
    """Latest attempts of running episodes, without the episodes that a task drives, by their identifiers."""
    latest = select(Attempt.episode_id, func.max(Attempt.number)).join(Episode).join(Evaluation)
    running = (Evaluation.status.in_(UNFINISHED), Episode.status == EpisodeStatus.RUNNING, Episode.id.not_in(live))
    return [AttemptKey(*row) for row in session.execute(latest.where(*running).group_by(Attempt.episode_id))]


def running(session: Session) -> list[Ticket]:
    """Episodes that were running when the service stopped."""
    found = [(session.get_one(Episode, key.episode_id), key) for key in undriven(session)]
    return [_ticket(episode, key, _waiting(episode.evaluation), used_up=False) for episode, key in found]


def unfinished(session: Session) -> list[str]:
    """Identifiers of unfinished evaluations."""
    return list(session.scalars(select(Evaluation.id).where(Evaluation.status.in_(UNFINISHED))))


def finish(
    session: Session,
    ticket: Ticket,
    record_hash: str,
    summary: dict[str, Any],
    ended: AttemptEnd,
    kept_bytes: int = 0,
) -> Progress | None:
    """Stores an episode's record, with the size of its files; None: the attempt no longer runs."""
    _hold(session, ticket.evaluation_id)
    changed = _change(
        session,
        ticket.key,
        status=EpisodeStatus.DONE,
        record_hash=record_hash,
        kept_bytes=kept_bytes,
        summary=summary,
        failure=None,
        finished=now(),
    )
    if not changed:
        return None
    attempts.end(session, ticket.key, ended)
    progress = _settle(session, ticket.evaluation_id)
    note_version(session, ticket.evaluation_id, summary)
    return progress


def give_up(session: Session, ticket: Ticket, ended: AttemptEnd, most_deaths: int) -> tuple[Next, Progress | None]:
    """Ends an attempt without a record: queues the episode again, or marks it as lost.

    Args:
        session: Session to write in.
        ticket: Ticket of the episode.
        ended: End of the attempt.
        most_deaths: Deaths of its process after which the episode is lost.

    Returns:
        What follows; the progress, where the episode is lost.
    """
    _hold(session, ticket.evaluation_id)
    if not _change(session, ticket.key, status=EpisodeStatus.RUNNING):
        return Next.NOTHING, None
    attempts.end(session, ticket.key, ended)
    so_far = attempts.tally(session, ticket.episode_id)
    if ended.outcome in LEAVING and so_far.used_up:
        return Next.AGENT_FAULT, None
    if so_far.hopeless(most_deaths):
        why = f"{ended.why} (resume drives it once more)"[:LONGEST_FAILURE]
        _change(session, ticket.key, status=EpisodeStatus.LOST, failure=why, finished=now())
        return Next.LOST, _settle(session, ticket.evaluation_id)
    _requeue(session, ticket.key, ended)
    return Next.AGAIN, None


def requeue(session: Session, key: AttemptKey, ended: AttemptEnd) -> None:
    """Ends a running attempt and returns its episode to the queue; it is driven again from its seed."""
    evaluation_id = session.scalar(select(Episode.evaluation_id).where(Episode.id == key.episode_id))
    if evaluation_id is not None and _hold(session, evaluation_id) is not None:
        _requeue(session, key, ended)


def fail(session: Session, ticket: Ticket, why: str, charged: Collection[str] = ()) -> Progress | None:
    """Fails an evaluation that cannot be driven; None: the attempt no longer runs. `charged` is that of `cancel`."""
    _hold(session, ticket.evaluation_id)
    failed = {"status": EpisodeStatus.CANCELLED, "failure": why[:LONGEST_FAILURE], "finished": now()}
    if not _change(session, ticket.key, **failed):
        return None
    return _stop(session, ticket.evaluation_id, EvaluationStatus.FAILED, why, charged)


def cancel(session: Session, evaluation_id: str, charged: Collection[str] = ()) -> Progress | None:
    """Cancels an evaluation; None: it has ended already.

    Args:
        session: Session to write in.
        evaluation_id: Identifier of the evaluation.
        charged: Identifiers of episodes whose attempt counts against the submission, since a worker drove.
    """
    return _stop(session, evaluation_id, EvaluationStatus.CANCELLED, None, charged)


def settle(session: Session, evaluation_id: str) -> Progress | None:
    """Ends an evaluation whose episodes have all ended; None: it does not exist."""
    return _settle(session, evaluation_id)


def _free(live: Collection[str]) -> tuple[ColumnElement[bool], ...]:
    """Conditions on `Episode`: it is queued, and no task drives an earlier attempt."""
    return Episode.status == EpisodeStatus.QUEUED, Episode.id.not_in(live)


def _waiting(evaluation: Evaluation) -> Waiting:
    submission = evaluation.submission
    return Waiting(evaluation.id, evaluation.owner, submission.kind, submission.agent.name, submission.version)


def _ticket(episode: Episode, key: AttemptKey, chosen: Waiting, used_up: bool) -> Ticket:
    evaluation = episode.evaluation
    submission: Submission = evaluation.submission
    return Ticket(
        key=key,
        waiting=chosen,
        position=episode.position,
        stem=episode.id,
        attempt=episode.attempts,
        used_up=used_up,
        info=submission.info,
        others={one.ego: one.submission.info for one in evaluation.egos},
        benchmark=(evaluation.benchmark.name, evaluation.benchmark_sha256),
        document=evaluation.benchmark.document,
        seeds=tuple(evaluation.seeds),
        slow_policy=evaluation.slow_policy,
        act_deadline_s=evaluation.act_deadline_s,
        agent_seed=agent_seed(evaluation.agent_secret, episode.position),
    )


def _requeue(session: Session, key: AttemptKey, ended: AttemptEnd) -> None:
    """`requeue` for an episode whose evaluation is locked."""
    count = Episode.attempts - 1 if ended.outcome in UNCOUNTED else Episode.attempts
    failure = ended.why[:LONGEST_FAILURE] if ended.why else None
    if _change(session, key, status=EpisodeStatus.QUEUED, attempts=count, failure=failure, started=None):
        attempts.end(session, key, ended)


def _hold(session: Session, evaluation_id: str) -> Evaluation | None:
    """The evaluation, locked. A change of its episodes locks it first, or two changes would wait for each other."""
    return session.get(Evaluation, evaluation_id, with_for_update={"of": Evaluation})


def _change(session: Session, key: AttemptKey, **values: Any) -> bool:
    """Changes the episode of a running attempt; False: it has ended, or a later one has begun."""
    wanted = update(Episode).where(key.is_latest, Episode.status == EpisodeStatus.RUNNING)
    result: Any = session.execute(wanted.values(**values).execution_options(synchronize_session=False))
    return bool(result.rowcount)


def _counts(session: Session, evaluation_id: str) -> Callable[[EpisodeStatus], int]:
    query = select(Episode.status, func.count()).where(Episode.evaluation_id == evaluation_id).group_by(Episode.status)
    found: dict[EpisodeStatus, int] = {row[0]: row[1] for row in session.execute(query)}
    return lambda status: found.get(status, 0)


def _settle(session: Session, evaluation_id: str) -> Progress | None:
    evaluation = _hold(session, evaluation_id)
    if evaluation is None:
        return None
    count = _counts(session, evaluation_id)
    done, total = count(EpisodeStatus.DONE), sum(map(count, EpisodeStatus))
    open_ones = count(EpisodeStatus.QUEUED) + count(EpisodeStatus.RUNNING)
    ends = evaluation.status in UNFINISHED and not open_ones
    if ends:
        _hold_ranking(session, evaluation)
        evaluation.finished = now()
        evaluation.status = EvaluationStatus.DONE if done == total else EvaluationStatus.FAILED
        evaluation.failure = _why_no_score(session, evaluation_id, total - done, total)
    return Progress(evaluation_id, evaluation.status, done, total, ends)


def _hold_ranking(session: Session, evaluation: Evaluation) -> None:
    """Locks a run's ranking, so that its board cannot become final between the time of the run's end and the commit."""
    if evaluation.ranking_id is not None:
        session.get(Ranking, evaluation.ranking_id, with_for_update={"read": True, "of": Ranking})


def _why_no_score(session: Session, evaluation_id: str, missing: int, total: int) -> str | None:
    """Why a run that ends has failed, or has no score; None for one that has."""
    if missing:
        return _why_not(session, evaluation_id, missing, total)
    done = select(Episode.summary).where(Episode.evaluation_id == evaluation_id, Episode.status == EpisodeStatus.DONE)
    with closing(session.scalars(done.order_by(Episode.position))) as summaries:
        return NO_SCORE if all(map(is_lost, summaries)) else None


def _why_not(session: Session, evaluation_id: str, missing: int, total: int) -> str:
    query = select(Episode.failure).where(Episode.evaluation_id == evaluation_id, Episode.status == EpisodeStatus.LOST)
    first = session.scalars(query.order_by(Episode.position).limit(1)).first()
    return f"{missing} of {total} episodes were lost to the infrastructure, such as: {first}"[:LONGEST_FAILURE]


def _stop(
    session: Session,
    evaluation_id: str,
    status: EvaluationStatus,
    why: str | None,
    charged: Collection[str] = (),
) -> Progress | None:
    evaluation = _hold(session, evaluation_id)
    if evaluation is None or evaluation.status not in UNFINISHED:
        return None
    for key in attempts.running_attempts(session, evaluation_id):
        attempts.end(session, key, AttemptEnd(AttemptOutcome.CANCELLED, why), key.episode_id in charged)
    unended = (EpisodeStatus.QUEUED, EpisodeStatus.RUNNING)
    wanted = update(Episode).where(Episode.evaluation_id == evaluation_id, Episode.status.in_(unended))
    values = {"status": EpisodeStatus.CANCELLED, "finished": now()}
    session.execute(wanted.values(values).execution_options(synchronize_session=False))
    evaluation.status, evaluation.finished, evaluation.failure = status, now(), why[:LONGEST_FAILURE] if why else None
    count = _counts(session, evaluation_id)
    return Progress(evaluation_id, status, count(EpisodeStatus.DONE), sum(map(count, EpisodeStatus)), True)
