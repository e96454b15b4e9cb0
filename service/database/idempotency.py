"""Idempotency: a request sent twice with the same key makes one thing."""

from __future__ import annotations

from datetime import timedelta

from sqlalchemy import delete
from sqlalchemy.orm import Session

from dohyo.service.database.engine import serialise
from dohyo.service.database.models import Idempotency, now
from dohyo.sumo_networks.errors import InvalidInputError

KEPT = timedelta(days=7)


def made_before(session: Session, owner: str, key: str | None, request_sha256: str) -> str | None:
    """Identifier of what the same request made before; None if it is new.

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
    """Keeps what a request made, for a week."""
    if key is None:
        return
    session.execute(delete(Idempotency).where(Idempotency.created < now() - KEPT))
    session.add(Idempotency(owner=owner, key=key, request_sha256=request_sha256, made=made))
    session.flush()
