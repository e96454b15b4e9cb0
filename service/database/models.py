"""Tables of the service. Facts of episodes are in records on disk; the tables hold owners, times and summaries."""

from __future__ import annotations

import secrets
from datetime import UTC, datetime
from enum import Enum, StrEnum
from typing import Any

from sqlalchemy import JSON, DateTime, ForeignKey, Index, String, TypeDecorator, UniqueConstraint
from sqlalchemy import Enum as EnumColumn
from sqlalchemy.engine import Dialect
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship


class Role(StrEnum):
    """Permissions of a token; each role includes those of `READER`."""

    ADMIN = "admin"
    SUBMITTER = "submitter"
    WORKER = "worker"
    READER = "reader"


class AgentKind(StrEnum):
    """Kind of a submission."""

    BUILTIN = "builtin"
    ONNX = "onnx"
    REMOTE = "remote"


class EvaluationStatus(StrEnum):
    """Status of an evaluation. DONE: every episode has a record that counts."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def finished(self) -> bool:
        """Whether the status is final unless the evaluation is resumed."""
        return self in (EvaluationStatus.DONE, EvaluationStatus.FAILED, EvaluationStatus.CANCELLED)


class EpisodeStatus(StrEnum):
    """Status of an episode. LOST: two infrastructure faults, which say nothing about the agent."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    LOST = "lost"
    CANCELLED = "cancelled"


class UtcDateTime(TypeDecorator[datetime]):
    """A time in UTC; SQLite drops the zone, which is restored here."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Restores the zone."""
        return value.replace(tzinfo=UTC) if value is not None and value.tzinfo is None else value


def now() -> datetime:
    """The current time."""
    return datetime.now(UTC)


def new_id(prefix: str) -> str:
    """A random identifier, such as "ev-9f86d081884c7d65"."""
    return f"{prefix}-{secrets.token_hex(8)}"


class Base(DeclarativeBase):
    """Base of all tables."""

    type_annotation_map = {  # noqa: RUF012
        datetime: UtcDateTime,
        dict[str, Any]: JSON,
        list[int]: JSON,
        # As plain text, so that a new member needs no change of a database's types.
        Enum: EnumColumn(Enum, native_enum=False, length=20, values_callable=lambda kind: [one.value for one in kind]),
    }


class Token(Base):
    """A bearer token, stored hashed. Other owners cannot change what its `owner` submits."""

    __tablename__ = "tokens"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100), index=True)
    role: Mapped[Role]
    sha256: Mapped[str] = mapped_column(String(64), unique=True)
    created: Mapped[datetime] = mapped_column(default=now)
    expires: Mapped[datetime | None]
    revoked: Mapped[datetime | None]


class Agent(Base):
    """A named line of submissions of one owner."""

    __tablename__ = "agents"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    name: Mapped[str] = mapped_column(String(100), unique=True)
    owner: Mapped[str] = mapped_column(String(100), index=True)
    description: Mapped[str] = mapped_column(String(2000), default="")
    created: Mapped[datetime] = mapped_column(default=now)
    submissions: Mapped[list[Submission]] = relationship(back_populates="agent", order_by="Submission.version")


class Submission(Base):
    """One version of an agent; never changes. `info` is the AgentInfo that its records will carry."""

    __tablename__ = "submissions"
    __table_args__ = (UniqueConstraint("agent_id", "version"),)

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    agent_id: Mapped[str] = mapped_column(ForeignKey("agents.id"), index=True)
    version: Mapped[int]
    kind: Mapped[AgentKind]
    track: Mapped[str] = mapped_column(String(20), index=True)
    info: Mapped[dict[str, Any]]
    policy_sha256: Mapped[str | None] = mapped_column(String(64))
    created: Mapped[datetime] = mapped_column(default=now)
    agent: Mapped[Agent] = relationship(back_populates="submissions", lazy="joined")


class BenchmarkVersion(Base):
    """A benchmark as it was when it was first evaluated; the version is its content hash."""

    __tablename__ = "benchmarks"

    sha256: Mapped[str] = mapped_column(String(64), primary_key=True)
    name: Mapped[str] = mapped_column(String(100), index=True)
    document: Mapped[dict[str, Any]]
    created: Mapped[datetime] = mapped_column(default=now)


class Evaluation(Base):
    """One submission on one benchmark version. `announced` is the end that was announced to webhooks."""

    __tablename__ = "evaluations"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100), index=True)
    submission_id: Mapped[str] = mapped_column(ForeignKey("submissions.id"), index=True)
    benchmark_sha256: Mapped[str] = mapped_column(ForeignKey("benchmarks.sha256"), index=True)
    seeds: Mapped[list[int]]
    status: Mapped[EvaluationStatus] = mapped_column(default=EvaluationStatus.QUEUED, index=True)
    slow_policy: Mapped[str] = mapped_column(String(10), default="wait")
    act_deadline_s: Mapped[float]
    failure: Mapped[str | None] = mapped_column(String(2000))
    created: Mapped[datetime] = mapped_column(default=now)
    started: Mapped[datetime | None]
    finished: Mapped[datetime | None]
    announced: Mapped[datetime | None]
    submission: Mapped[Submission] = relationship(lazy="joined")
    benchmark: Mapped[BenchmarkVersion] = relationship()


class Episode(Base):
    """One scenario of an evaluation.

    `summary` holds the numbers that pages sort and count by (`dohyo.service.scoring.summary_of`), recomputable from the
    record.
    """

    __tablename__ = "episodes"
    __table_args__ = (UniqueConstraint("evaluation_id", "position"), Index("by_status", "evaluation_id", "status"))

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    evaluation_id: Mapped[str] = mapped_column(ForeignKey("evaluations.id"), index=True)
    position: Mapped[int]
    scenario: Mapped[str] = mapped_column(String(220))
    cell: Mapped[str] = mapped_column(String(100))
    seed: Mapped[int]
    status: Mapped[EpisodeStatus] = mapped_column(default=EpisodeStatus.QUEUED)
    attempts: Mapped[int] = mapped_column(default=0)
    record_hash: Mapped[str | None] = mapped_column(String(64), index=True)
    summary: Mapped[dict[str, Any] | None]
    failure: Mapped[str | None] = mapped_column(String(2000))
    started: Mapped[datetime | None]
    finished: Mapped[datetime | None]
    evaluation: Mapped[Evaluation] = relationship()


class Webhook(Base):
    """A URL for an owner's messages at the end of evaluations; bodies are signed with the secret (HMAC-SHA256)."""

    __tablename__ = "webhooks"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100), index=True)
    url: Mapped[str] = mapped_column(String(2000))
    secret: Mapped[str] = mapped_column(String(100))
    created: Mapped[datetime] = mapped_column(default=now)


class Delivery(Base):
    """One message to one webhook, sent again until it is accepted or given up."""

    __tablename__ = "deliveries"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    webhook_id: Mapped[str] = mapped_column(ForeignKey("webhooks.id", ondelete="CASCADE"), index=True)
    body: Mapped[dict[str, Any]]
    attempts: Mapped[int] = mapped_column(default=0)
    due: Mapped[datetime] = mapped_column(default=now, index=True)
    delivered: Mapped[datetime | None]
    failure: Mapped[str | None] = mapped_column(String(500))


class Idempotency(Base):
    """Result of a request with an `Idempotency-Key`, so that its repetition creates nothing new."""

    __tablename__ = "idempotency"

    owner: Mapped[str] = mapped_column(String(100), primary_key=True)
    key: Mapped[str] = mapped_column(String(200), primary_key=True)
    request_sha256: Mapped[str] = mapped_column(String(64))
    made: Mapped[str] = mapped_column(String(32))
    created: Mapped[datetime] = mapped_column(default=now, index=True)
