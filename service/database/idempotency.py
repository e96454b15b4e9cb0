"""Idempotency: a request sent twice with the same key has one effect."""

from __future__ import annotations

from datetime import datetime, timedelta

from sqlalchemy import String, delete
from sqlalchemy.orm import Mapped, Session, mapped_column

from dohyo.service.database.base import Base, now
from dohyo.service.database.engine import serialise
from dohyo.sumo_networks.errors import InvalidInputError


class Idempotency(Base):
    """Result of a request with an `Idempotency-Key`, so that its repetition creates nothing new."""

    __tablename__ = "idempotency"

    owner: Mapped[str] = mapped_column(String(100), primary_key=True)
    key: Mapped[str] = mapped_column(String(200), primary_key=True)
    request_sha256: Mapped[str] = mapped_column(String(64))
    made: Mapped[str] = mapped_column(String(32))
    created: Mapped[datetime] = mapped_column(default=now, index=True)


KEPT = timedelta(days=7)


def made_before(session: Session, owner: str, key: str | None, request_sha256: str) -> str | None:
    """Identifier of the resource that the same request created before; None for a new request.

    Raises:
        InvalidInputError: The key was used for another request.
    """
    if key is None:
        return None
    serialise(session)
    before = session.get(Idempotency, (owner, key))
    if before is None or before.created < now() - KEPT:
        return None
    if before.request_sha256 != request_sha256:
        raise InvalidInputError("Idempotency-Key: this key was used for another request")
    return before.made


def remember(session: Session, owner: str, key: str | None, request_sha256: str, made: str) -> None:
    """Stores the identifier of a created resource for a week."""
    if key is None:
        return
    session.execute(delete(Idempotency).where(Idempotency.created < now() - KEPT))
    # Replaces the key of a resource that was deleted since.
    session.merge(Idempotency(owner=owner, key=key, request_sha256=request_sha256, made=made, created=now()))
    session.flush()
