"""Who may see a world: its owner and administrators."""

from __future__ import annotations

import asyncio

from sqlalchemy.orm import Session

from dohyo.service.accounts.access import Caller
from dohyo.service.errors import ConflictError, NotFoundError
from dohyo.service.state import Services
from dohyo.service.worlds.model import World
from dohyo.service.worlds.world import LiveWorld


def world_of(session: Session, caller: Caller, identifier: str) -> World:
    """A world of the caller.

    Raises:
        NotFoundError: The caller has no such world.
    """
    row = session.get(World, identifier)
    if row is None or not caller.owns(row.owner):
        raise NotFoundError(f"no world '{identifier}' of yours")
    return row


async def find_world(services: Services, caller: Caller, identifier: str) -> World:
    """A world of the caller, read in a thread.

    Raises:
        NotFoundError: The caller has no such world.
    """

    def find() -> World:
        with services.database.reading() as session:
            return world_of(session, caller, identifier)

    return await asyncio.to_thread(find)


async def live_world(services: Services, caller: Caller, identifier: str) -> LiveWorld:
    """A live world of the caller; this counts as a request to it.

    Raises:
        NotFoundError: The caller has no such world.
        ConflictError: It has ended.
    """
    await find_world(services, caller, identifier)
    world = services.worlds.find(identifier)
    if world is None or world.ending:
        raise ConflictError(f"world '{identifier}' has ended")
    return world
