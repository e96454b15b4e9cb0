"""Who may see a world: its owner, administrators, and guests. Only the first two control it."""

from __future__ import annotations

import asyncio

from sqlalchemy.orm import Session

from dohyo.service.accounts.access import Caller
from dohyo.service.errors import ConflictError, ForbiddenError, NotFoundError
from dohyo.service.state import Services
from dohyo.service.worlds.live.world import LiveWorld
from dohyo.service.worlds.model import World, WorldGuest


def world_of(session: Session, caller: Caller, identifier: str, *, own: bool = False) -> World:
    """A world that the caller may see.

    Args:
        session: To read in.
        caller: Who asks.
        identifier: Identifier of the world.
        own: Whether it must be the caller's own, since it is controlled.

    Raises:
        NotFoundError: The caller may see no such world.
        ForbiddenError: The caller is a guest there.
    """
    row = session.get(World, identifier)
    if row is not None and caller.owns(row.owner):
        return row
    if row is None or session.get(WorldGuest, (identifier, caller.owner)) is None:
        raise NotFoundError(f"no world '{identifier}' of yours")
    if own:
        raise ForbiddenError(f"world '{identifier}' is of '{row.owner}', who invited you: only its owner controls it")
    return row


async def find_world(services: Services, caller: Caller, identifier: str, *, own: bool = False) -> World:
    """The same, read in a thread.

    Raises:
        NotFoundError: The caller may see no such world.
        ForbiddenError: The caller is a guest there, and it must be an own one.
    """

    def find() -> World:
        with services.database.reading() as session:
            return world_of(session, caller, identifier, own=own)

    return await asyncio.to_thread(find)


async def live_world(services: Services, caller: Caller, identifier: str, *, own: bool = True) -> LiveWorld:
    """A live world, by default one that the caller controls; this counts as a request to it.

    Raises:
        NotFoundError: The caller may see no such world.
        ForbiddenError: The caller is a guest there, and it must be an own one.
        ConflictError: It has ended.
    """
    await find_world(services, caller, identifier, own=own)
    world = services.worlds.find(identifier)
    if world is None or world.ending:
        raise ConflictError(f"world '{identifier}' has ended")
    if not is_admitted(caller, world):  # a guest that was dismissed since its row was read
        raise NotFoundError(f"no world '{identifier}' of yours")
    return world


def is_admitted(caller: Caller, world: LiveWorld) -> bool:
    """Whether the caller may be in a live world, as far as this process knows now."""
    return caller.owns(world.owner) or world.guests.has(caller.owner)
