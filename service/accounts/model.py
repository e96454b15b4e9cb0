"""Tokens and their roles."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum

from sqlalchemy import String
from sqlalchemy.orm import Mapped, mapped_column

from dohyo.service.database.base import Base, now


class Role(StrEnum):
    """Permissions of a token; each role includes those of `READER`.

    ORGANISER: makes challenges and manages its owner's own ones, and may do what `SUBMITTER` may.
    """

    ADMIN = "admin"
    ORGANISER = "organiser"
    SUBMITTER = "submitter"
    WORKER = "worker"
    READER = "reader"


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
