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
    return world


async def admit(services: Services, caller: Caller, identifier: str, code: str) -> None:
    """Makes the caller a guest of a live world, by the code of an invitation.

    Raises:
        NotFoundError: There is no such invitation, or another owner has used it.
    """
    world = services.worlds.find(identifier, heard=False)
    if world is None:
        raise NotFoundError(f"no world '{identifier}' of yours")
    world.guests.admit(code, caller.owner)

    def add() -> None:
        with services.database.session() as session:
            session.merge(WorldGuest(world_id=identifier, owner=caller.owner))

    await asyncio.to_thread(add)
