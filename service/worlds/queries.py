"""Queries of worlds."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from sqlalchemy import delete, func, or_, select, update
from sqlalchemy.orm import Session

from dohyo.service.database.base import now
from dohyo.service.worlds.model import LIVE, World, WorldGuest, WorldStatus

KEPT_PER_OWNER = 1000


def list_worlds(session: Session, owner: str | None, limit: int, after: str | None) -> Sequence[World]:
    """Worlds of an owner or guest (None: all worlds) by identifier, those past `after`."""
    query = select(World).order_by(World.id).limit(limit)
    if owner is not None:
        invited = select(WorldGuest.world_id).where(WorldGuest.owner == owner)
        query = query.where(or_(World.owner == owner, World.id.in_(invited)))
    return session.scalars(query.where(World.id > after) if after else query).all()


def list_guests(session: Session, identifier: str, limit: int, after: str | None) -> Sequence[WorldGuest]:
    """Guests of a world by their names, those past `after`."""
    query = select(WorldGuest).where(WorldGuest.world_id == identifier).order_by(WorldGuest.owner).limit(limit)
    return session.scalars(query.where(WorldGuest.owner > after) if after else query).all()


def add_guest(session: Session, identifier: str, owner: str) -> None:
    """Makes an owner a guest of a world; one that is a guest stays so."""
    if session.get(WorldGuest, (identifier, owner)) is None:
        session.add(WorldGuest(world_id=identifier, owner=owner))


def remove_guest(session: Session, identifier: str, owner: str) -> bool:
    """Removes a guest of a world; returns whether there was one."""
    guest = session.get(WorldGuest, (identifier, owner))
    if guest is not None:
        session.delete(guest)
    return guest is not None


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


def delete_world(session: Session, row: World) -> None:
    """Deletes a world and the list of its guests."""
    session.execute(delete(WorldGuest).where(WorldGuest.world_id == row.id))
    session.delete(row)


def retire_worlds(session: Session, before: datetime) -> list[str]:
    """Marks the records of worlds that ended before a moment as no longer kept; returns the worlds' identifiers."""
    old = (World.finished < before, World.kept_bytes > 0)
    identifiers = list(session.scalars(select(World.id).where(*old)))
    session.execute(update(World).where(World.id.in_(identifiers)).values(kept_bytes=0))
    return identifiers


def list_live_worlds(session: Session) -> Sequence[World]:
    """Worlds without a stored end."""
    return session.scalars(select(World).where(World.status.in_(LIVE))).all()
