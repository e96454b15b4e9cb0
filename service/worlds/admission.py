"""Admission: an owner becomes a guest of a live world by an invitation, until the world's owner dismisses it.

Each of the two is done to its end before the next one begins, so that no admission undoes a dismissal.
"""

from __future__ import annotations

import asyncio

from dohyo.service.accounts.access import Caller
from dohyo.service.errors import NotFoundError
from dohyo.service.state import Services
from dohyo.service.worlds import queries
from dohyo.service.worlds.access import world_of


async def admit(services: Services, caller: Caller, identifier: str, code: str) -> None:
    """Makes the caller a guest of a live world, by the code of an invitation; one whose world it is needs none.

    Raises:
        NotFoundError: No invitation with this code admits the caller.
    """
    world = services.worlds.find(identifier, heard=False)
    if world is None or caller.owns(world.owner):
        return

    def add() -> None:
        with services.database.session() as session:
            queries.add_guest(session, identifier, caller.owner)

    async def admit_in_turn() -> None:
        async with services.worlds.admission:
            world.guests.admit(code, caller.owner)
            await asyncio.to_thread(add)

    await asyncio.shield(asyncio.create_task(admit_in_turn()))  # the lock is held to the end


async def dismiss(services: Services, caller: Caller, identifier: str, owner: str) -> None:
    """Dismisses a guest of a world of the caller: what the guest does in it ends, and it sees the world no more.

    Raises:
        NotFoundError: The caller may see no such world, or it has no such guest.
        ForbiddenError: The caller is a guest there.
    """

    def remove() -> None:
        with services.database.session() as session:
            world_of(session, caller, identifier, own=True)
            if not queries.remove_guest(session, identifier, owner):
                raise NotFoundError(f"world '{identifier}' has no guest '{owner}'")

    async def dismiss_in_turn() -> None:
        async with services.worlds.admission:
            await asyncio.to_thread(remove)
            if (world := services.worlds.find(identifier)) is not None:
                world.dismiss_guest(owner)

    await asyncio.shield(asyncio.create_task(dismiss_in_turn()))
