"""Queries of worlds."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from dohyo.service.database.base import now
from dohyo.service.worlds.model import LIVE, World, WorldStatus

KEPT_PER_OWNER = 1000


def list_worlds(session: Session, owner: str | None, limit: int, after: str | None) -> Sequence[World]:
    """Worlds of an owner (None: of all) by identifier, those past `after`."""
    query = select(World).order_by(World.id).limit(limit)
    if owner is not None:
        query = query.where(World.owner == owner)
    return session.scalars(query.where(World.id > after) if after else query).all()


def count_worlds(session: Session, owner: str) -> int:
    """Number of an owner's worlds, live or not."""
    return session.scalar(select(func.count()).select_from(World).where(World.owner == owner)) or 0


def finish_world(
    session: Session,
    identifier: str,
    status: WorldStatus,
    reason: str | None,
    tick: int,
    record: tuple[str, int] | None,
) -> None:
    """Stores how a world has ended, with the hash and the size of its record if it has one."""
    record_hash, kept_bytes = record or (None, 0)
    values = {"status": status, "reason": reason, "tick": tick, "record_hash": record_hash, "kept_bytes": kept_bytes}
    session.execute(update(World).where(World.id == identifier).values(finished=now(), **values))


def fail_live_worlds(session: Session, reason: str) -> int:
    """Ends the worlds of an earlier service, which had no time to end them; returns their number."""
    values = {"status": WorldStatus.FAILED, "reason": reason, "finished": now()}
    result = session.execute(update(World).where(World.status.in_(LIVE)).values(values))
    return int(getattr(result, "rowcount", 0))
