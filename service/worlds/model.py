"""Worlds in the database: who made them, and how they ended. What a live world does is in memory."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Any

from sqlalchemy import BigInteger, String
from sqlalchemy.orm import Mapped, mapped_column

from dohyo.service.database.base import Base, now


class WorldStatus(StrEnum):
    """Status of a world.

    WAITING: for its first drivers. RUNNING: it ticks with its drivers. PAUSED: it stands still. OVER: all egos have
    ended, and it stays for a reset. DONE: all egos have ended. ENDED: at a request, or after a time without requests.
    FAILED: the simulation or the service failed.
    """

    WAITING = "waiting"
    RUNNING = "running"
    PAUSED = "paused"
    OVER = "over"
    DONE = "done"
    ENDED = "ended"
    FAILED = "failed"

    @property
    def live(self) -> bool:
        """Whether the world still has a process."""
        return self in LIVE


LIVE = (WorldStatus.WAITING, WorldStatus.RUNNING, WorldStatus.PAUSED, WorldStatus.OVER)


class World(Base):
    """A live scenario. The status of a live world is WAITING here; `LiveWorld` knows the present one."""

    __tablename__ = "worlds"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100), index=True)
    order: Mapped[dict[str, Any]]
    status: Mapped[WorldStatus] = mapped_column(default=WorldStatus.WAITING, index=True)
    created: Mapped[datetime] = mapped_column(default=now)
    finished: Mapped[datetime | None]
    reason: Mapped[str | None] = mapped_column(String(2000))
    tick: Mapped[int] = mapped_column(default=0)
    record_hash: Mapped[str | None] = mapped_column(String(64))
    kept_bytes: Mapped[int] = mapped_column(BigInteger, default=0)

    @property
    def network(self) -> str:
        """Name of its network."""
        return str(self.order["scenario"]["network"])


class WorldGuest(Base):
    """An owner who has joined the world of another one by an invitation, and may see it and its record."""

    __tablename__ = "world_guests"

    world_id: Mapped[str] = mapped_column(String(32), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100), primary_key=True, index=True)
    admitted: Mapped[datetime | None] = mapped_column(default=now)  # None: by a version that did not keep the time
