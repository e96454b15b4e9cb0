"""Jobs: heavy work that was ordered, and what became of it."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Any

from sqlalchemy import BigInteger, Index, String
from sqlalchemy.orm import Mapped, mapped_column

from dohyo.service.database.base import Base, now


class JobStatus(StrEnum):
    """Status of a job. FAILED: its `problem` says why; CANCELLED: by its owner or an administrator."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def finished(self) -> bool:
        """Whether the status is final."""
        return self not in UNFINISHED


UNFINISHED = (JobStatus.QUEUED, JobStatus.RUNNING)


class Job(Base):
    """One order of heavy work. Its uploaded file, if it has one, lies in a folder of the job's name until its end.

    `result` is the path of what the job made, `answer` the body that its order answers once the job is done, `problem`
    the one that it answers otherwise. Jobs of one owner and kind with the same `subject` would do the same.
    """

    __tablename__ = "jobs"
    __table_args__ = (Index("jobs_by_owner", "owner", "status"), Index("jobs_by_status", "status", "created"))

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    kind: Mapped[str] = mapped_column(String(40))
    owner: Mapped[str] = mapped_column(String(100))
    status: Mapped[JobStatus] = mapped_column(default=JobStatus.QUEUED)
    arguments: Mapped[dict[str, Any]]
    subject: Mapped[str | None] = mapped_column(String(100), index=True)
    upload_bytes: Mapped[int] = mapped_column(BigInteger, default=0)
    starts: Mapped[int] = mapped_column(default=0)
    result: Mapped[str | None] = mapped_column(String(400))
    answer: Mapped[dict[str, Any] | None]
    problem: Mapped[dict[str, Any] | None]
    created: Mapped[datetime] = mapped_column(default=now)
    started: Mapped[datetime | None]
    finished: Mapped[datetime | None]
