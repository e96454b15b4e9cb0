"""Agents and their submissions."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Any

from sqlalchemy import BigInteger, ForeignKey, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column, relationship

from dohyo.service.database.base import Base, now


class AgentKind(StrEnum):
    """Kind of a submission."""

    BUILTIN = "builtin"
    ONNX = "onnx"
    REMOTE = "remote"


class Agent(Base):
    """A named line of submissions of one owner; `newest` is the last version that was ever given."""

    __tablename__ = "agents"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    name: Mapped[str] = mapped_column(String(100), unique=True)
    owner: Mapped[str] = mapped_column(String(100), index=True)
    description: Mapped[str] = mapped_column(String(2000), default="")
    newest: Mapped[int] = mapped_column(default=0)
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
    kept_bytes: Mapped[int] = mapped_column(BigInteger, default=0)
    created: Mapped[datetime] = mapped_column(default=now)
    agent: Mapped[Agent] = relationship(back_populates="submissions", lazy="joined")
