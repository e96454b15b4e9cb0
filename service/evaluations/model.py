"""Evaluations and their episodes. Facts are in records on disk; the tables hold owners, times and summaries."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from datetime import datetime
from enum import StrEnum
from typing import Any, Final

from sqlalchemy import JSON, BigInteger, ForeignKey, Index, String, UniqueConstraint, text
from sqlalchemy.orm import Mapped, mapped_column, relationship

from dohyo.evaluation.benchmarks.documents import family_of
from dohyo.evaluation.families import Family
from dohyo.evaluation.records.specifications import Status
from dohyo.service.boards.model import Ranking
from dohyo.service.database.base import Base, now
from dohyo.service.submissions.model import AgentKind, Submission


class EvaluationStatus(StrEnum):
    """Status of an evaluation. DONE: every episode has a record."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def finished(self) -> bool:
        """Whether the status is final unless the evaluation is resumed."""
        return self not in UNFINISHED


UNFINISHED: Final = (EvaluationStatus.QUEUED, EvaluationStatus.RUNNING)


class EpisodeStatus(StrEnum):
    """Status of an episode.

    DONE: it has a record, which counts unless the traffic was gridlocked, see `is_lost`. LOST: it has none, since the
    infrastructure failed too often, which says nothing about the agent.
    """

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    LOST = "lost"
    CANCELLED = "cancelled"


class AttemptOutcome(StrEnum):
    """End of an attempt.

    DONE: a record. AGENT_FAILED: the same, with a fault of the agent. WORKER_GONE: the policy worker fell
    silent. GIVEN_BACK: the policy worker released the episode without an error. MACHINE: the episode's process died.
    SIMULATION: SUMO failed, or the disk. UNCLAIMED: no worker came. DRAINED: the service ended. CANCELLED: the
    evaluation was cancelled, or cannot be driven.
    """

    DONE = "done"
    AGENT_FAILED = "agent_failed"
    WORKER_GONE = "worker_gone"
    GIVEN_BACK = "given_back"
    MACHINE = "machine"
    SIMULATION = "simulation"
    UNCLAIMED = "unclaimed"
    DRAINED = "drained"
    CANCELLED = "cancelled"


class BenchmarkVersion(Base):
    """A benchmark as it was when it was first evaluated; the version is its content hash."""

    __tablename__ = "benchmarks"

    sha256: Mapped[str] = mapped_column(String(64), primary_key=True)
    name: Mapped[str] = mapped_column(String(100), index=True)
    document: Mapped[dict[str, Any]]
    created: Mapped[datetime] = mapped_column(default=now)

    @property
    def kind(self) -> Family:
        """Whether agents drive cars or park karts in it, or planners set the speeds of connected cars."""
        return family_of(self.document, self.name)


UNANNOUNCED: Final = text("announced IS NULL OR announced < finished")
NEXT_NUMBER: Final = text("(SELECT coalesce(max(number), 0) + 1 FROM evaluations)")


class Evaluation(Base):
    """One submission on one benchmark version. `announced` is the end that was announced to webhooks.

    A run with a `ranking_id` is *ranked*, and its conditions are the ranking's; one without is *practice*. `team_id` is
    the team that the run was ordered for, in a phase of a challenge. A run with `egos` is *mixed*: other submissions
    drive them, and the evaluation's own drives all other egos.

    `number` grows with each order, also where the clock is set back, so that it tells which run was ordered first.
    `serialise` before an evaluation is added.

    `dohyo_versions` are those that drove its episodes, in the order of their first record: usually one.

    The seeds of remote agents follow from `agent_secret`, which no answer shows. `failure` says why the run failed, or
    why one that is done has no score.
    """

    __tablename__ = "evaluations"
    __table_args__ = (
        Index("by_ranking", "ranking_id", "status"),
        Index("by_creation", "created", "id"),
        Index("unannounced", "status", sqlite_where=UNANNOUNCED, postgresql_where=UNANNOUNCED),
    )

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100), index=True)
    submission_id: Mapped[str] = mapped_column(ForeignKey("submissions.id"), index=True)
    benchmark_sha256: Mapped[str] = mapped_column(ForeignKey("benchmarks.sha256"), index=True)
    ranking_id: Mapped[str | None] = mapped_column(ForeignKey("rankings.id"))
    team_id: Mapped[str | None] = mapped_column(ForeignKey("teams.id"), index=True)
    seeds: Mapped[list[int]]
    status: Mapped[EvaluationStatus] = mapped_column(default=EvaluationStatus.QUEUED, index=True)
    slow_policy: Mapped[str] = mapped_column(String(10), default="wait")
    act_deadline_s: Mapped[float]
    failure: Mapped[str | None] = mapped_column(String(2000))
    created: Mapped[datetime] = mapped_column(default=now)
    started: Mapped[datetime | None]
    finished: Mapped[datetime | None]
    announced: Mapped[datetime | None]
    # Nullable, since SQLite adds no column without a default that must have a value; the migration fills it.
    dohyo_versions: Mapped[list[str]] = mapped_column(JSON, default=list, nullable=True)
    number: Mapped[int] = mapped_column(default=NEXT_NUMBER, index=True, nullable=True)  # nullable as above
    agent_secret: Mapped[str] = mapped_column(String(64), default=lambda: secrets.token_hex(32))
    submission: Mapped[Submission] = relationship(lazy="joined")
    benchmark: Mapped[BenchmarkVersion] = relationship()
    ranking: Mapped[Ranking | None] = relationship()
    egos: Mapped[list[EvaluationEgo]] = relationship(
        lazy="selectin", order_by="EvaluationEgo.ego", cascade="all, delete-orphan"
    )

    @property
    def mixed(self) -> bool:
        """Whether its egos have different agents."""
        return bool(self.egos)

    def hidden_statuses(self, told: bool) -> frozenset[EpisodeStatus]:
        """Statuses of its episodes that answers hide while it lasts: they show `QUEUED`.

        Of a remote agent all but `DONE`, since a worker could read which episode it drives. Where the records are
        withheld all, since the moment at which an episode is done tells how long its drive was.

        Args:
            told: Whether the reader may see the records.
        """
        if self.status.finished:
            return frozenset()
        if not told:
            return frozenset(EpisodeStatus)
        remote = self.submission.kind is AgentKind.REMOTE
        return frozenset(EpisodeStatus) - {EpisodeStatus.DONE} if remote else frozenset()


class EvaluationEgo(Base):
    """An ego of a mixed run, in every scenario, that another submission drives than the evaluation's own."""

    __tablename__ = "evaluation_egos"

    evaluation_id: Mapped[str] = mapped_column(ForeignKey("evaluations.id"), primary_key=True)
    ego: Mapped[str] = mapped_column(String(100), primary_key=True)
    submission_id: Mapped[str] = mapped_column(ForeignKey("submissions.id"), index=True)
    submission: Mapped[Submission] = relationship(lazy="joined")


class Episode(Base):
    """One scenario of an evaluation.

    `attempts` counts the starts, without those that ended as UNCLAIMED or DRAINED; nothing resets it.
    `summary` holds the numbers that pages sort and count by (`dohyo.service.evaluations.scoring.summary_of`),
    recomputable from the record. `kept_bytes` is the size of the record's files, 0 once they are removed.
    """

    __tablename__ = "episodes"
    __table_args__ = (
        UniqueConstraint("evaluation_id", "position"),
        Index("by_status", "evaluation_id", "status"),
        Index("by_evaluation", "evaluation_id", "id"),
    )

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    evaluation_id: Mapped[str] = mapped_column(ForeignKey("evaluations.id"))
    position: Mapped[int]
    scenario: Mapped[str] = mapped_column(String(220))
    cell: Mapped[str] = mapped_column(String(100))
    seed: Mapped[int]
    status: Mapped[EpisodeStatus] = mapped_column(default=EpisodeStatus.QUEUED)
    attempts: Mapped[int] = mapped_column(default=0)
    record_hash: Mapped[str | None] = mapped_column(String(64), index=True)
    kept_bytes: Mapped[int] = mapped_column(BigInteger, default=0)
    summary: Mapped[dict[str, Any] | None]
    failure: Mapped[str | None] = mapped_column(String(2000))
    started: Mapped[datetime | None]
    finished: Mapped[datetime | None]
    evaluation: Mapped[Evaluation] = relationship()


def is_lost(summary: Mapping[str, Any] | None) -> bool:
    """Whether an episode with a record counts in no mean, for none of its egos: the traffic was gridlocked."""
    return any(Status(ego["status"]).infrastructure_fault for ego in (summary or {}).get("egos", ()))


class Attempt(Base):
    """One start of an episode. Rows are never changed after their end, nor deleted while the episode exists.

    `charged` says whether the attempt counts against the submission: its worker left the episode, or its owner
    cancelled the evaluation while the worker drove.
    """

    __tablename__ = "attempts"
    __table_args__ = (
        UniqueConstraint("episode_id", "number"),
        Index("charged_attempts", "episode_id", sqlite_where=text("charged = 1"), postgresql_where=text("charged")),
    )

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    episode_id: Mapped[str] = mapped_column(ForeignKey("episodes.id"), index=True)
    number: Mapped[int]
    started: Mapped[datetime] = mapped_column(default=now)
    ended: Mapped[datetime | None]
    outcome: Mapped[AttemptOutcome | None]
    why: Mapped[str | None] = mapped_column(String(2000))
    charged: Mapped[bool] = mapped_column(default=False)
    processor_s: Mapped[float] = mapped_column(default=0.0)
