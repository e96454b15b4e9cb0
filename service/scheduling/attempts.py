"""Attempts: every start of an episode is a row, from which the scheduler reads whether the episode is driven again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, and_, func, select, update
from sqlalchemy.orm import Session

from dohyo.evaluation.running.job import MAX_ATTEMPTS
from dohyo.service.database.base import new_id, now
from dohyo.service.evaluations.model import Attempt, AttemptOutcome, Episode

CHARGED_ATTEMPTS = 2
"""Attempts that count against the submission, after which the episode is recorded as a fault of the agent."""
SECOND_TRIES, SECOND_TRY_SHARE = 1, 0.1
"""Number of episodes of a ranked run that are driven again after a charged attempt, and the share of all beside it.

Who leaves a bad drive knows what comes when it is driven again.
"""
LONGEST_WHY = 2000
LEAVING = (AttemptOutcome.WORKER_GONE, AttemptOutcome.GIVEN_BACK)
UNCOUNTED = (AttemptOutcome.UNCLAIMED, AttemptOutcome.DRAINED)


@dataclass(frozen=True, slots=True)
class AttemptKey:
    """Key of an attempt, which tells it from later ones of the same episode.

    Attributes:
        episode_id: Identifier of the episode.
        number: Number among all attempts of the episode, whatever their outcome, from 1.
    """

    episode_id: str
    number: int

    @property
    def is_latest(self) -> ColumnElement[bool]:
        """Condition on `Episode`: it is the attempt's, and no later attempt has begun."""
        latest = select(func.max(Attempt.number)).where(Attempt.episode_id == self.episode_id).scalar_subquery()
        return and_(Episode.id == self.episode_id, latest == self.number)


@dataclass(frozen=True, slots=True)
class AttemptEnd:
    """End of an attempt that gave no record.

    Attributes:
        outcome: Kind of the end.
        why: Reason, for people; None: the service ended.
        processor_s: Processor time of the episode's process, s.
    """

    outcome: AttemptOutcome
    why: str | None = None
    processor_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Tally:
    """Numbers of an episode's ended attempts.

    Attributes:
        charged: Attempts that count against the submission.
        deaths: Attempts whose process died.
        failures: Attempts in which SUMO or the disk failed.
        second_try: Whether the run has a second try for this episode.
    """

    charged: int
    deaths: int
    failures: int
    second_try: bool = True

    @property
    def used_up(self) -> bool:
        """Whether the submission has no attempt left."""
        return self.charged >= (CHARGED_ATTEMPTS if self.second_try else 1)

    def hopeless(self, most_deaths: int) -> bool:
        """Whether the infrastructure failed too often to try again."""
        return self.deaths >= most_deaths or self.failures >= MAX_ATTEMPTS


def begin(session: Session, episode: Episode) -> AttemptKey:
    """Adds the row of an attempt that starts now."""
    last = session.scalar(select(func.max(Attempt.number)).where(Attempt.episode_id == episode.id)) or 0
    session.add(Attempt(id=new_id("at"), episode_id=episode.id, number=last + 1))
    return AttemptKey(episode.id, last + 1)


def end(session: Session, key: AttemptKey, ended: AttemptEnd, charged: bool | None = None) -> None:
    """Ends a running attempt; without effect where it has ended.

    Args:
        session: Session to write in.
        key: Key of the attempt.
        ended: End of the attempt.
        charged: Whether it counts against the submission; None: as its outcome says.
    """
    values: dict[str, Any] = {
        "ended": now(),
        "outcome": ended.outcome,
        "why": ended.why[:LONGEST_WHY] if ended.why else None,
        "charged": ended.outcome in LEAVING if charged is None else charged,
        "processor_s": ended.processor_s,
    }
    this = (Attempt.episode_id == key.episode_id, Attempt.number == key.number)
    running = update(Attempt).where(*this, Attempt.ended.is_(None))
    session.execute(running.values(values).execution_options(synchronize_session=False))


def tally(session: Session, episode_id: str) -> Tally:
    """Numbers of an episode's ended attempts."""
    query = select(Attempt.outcome, Attempt.charged, func.count()).where(Attempt.episode_id == episode_id)
    rows = session.execute(query.group_by(Attempt.outcome, Attempt.charged)).all()
    charged = sum(count for _, charged, count in rows if charged)
    return Tally(
        charged=charged,
        second_try=not charged or _has_second_try(session, episode_id),
        deaths=sum(count for outcome, _, count in rows if outcome is AttemptOutcome.MACHINE),
        failures=sum(count for outcome, _, count in rows if outcome is AttemptOutcome.SIMULATION),
    )


def _has_second_try(session: Session, episode_id: str) -> bool:
    """Whether the first charged attempt of an episode is among those of its run that are driven again."""
    run = session.get_one(Episode, episode_id).evaluation
    if run.ranking_id is None:
        return True
    of_run = select(Attempt.episode_id, func.min(Attempt.ended).label("ended")).join(Episode)
    of_run = of_run.where(Episode.evaluation_id == run.id, Attempt.charged).group_by(Attempt.episode_id)
    left = [row.episode_id for row in session.execute(of_run.order_by("ended", Attempt.episode_id))]
    episodes = session.scalar(select(func.count()).where(Episode.evaluation_id == run.id)) or 0
    return left.index(episode_id) < SECOND_TRIES + int(SECOND_TRY_SHARE * episodes)


def running_attempts(session: Session, evaluation_id: str) -> list[AttemptKey]:
    """Running attempts of an evaluation's episodes."""
    query = select(Attempt.episode_id, Attempt.number).join(Episode, Episode.id == Attempt.episode_id)
    found = session.execute(query.where(Episode.evaluation_id == evaluation_id, Attempt.ended.is_(None)))
    return [AttemptKey(*row) for row in found]
