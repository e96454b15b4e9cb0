"""Guests of worlds: invite other owners, list who was admitted, dismiss them."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path

from dohyo.service.accounts.access import Holder, Submitter
from dohyo.service.state import ServicesOf
from dohyo.service.web.bodies.strict_route import StrictRoute
from dohyo.service.web.documents import After, Identifier, Limit, problems
from dohyo.service.web.views import Page
from dohyo.service.worlds import queries
from dohyo.service.worlds.access import live_world, world_of
from dohyo.service.worlds.admission import dismiss
from dohyo.service.worlds.bodies import WorldInvitationRequest
from dohyo.service.worlds.views import WorldGuestView, WorldInvitationView
from dohyo.sumo_networks.errors import InvalidInputError

router = APIRouter(prefix="/v1", tags=["worlds"], route_class=StrictRoute)

GuestName = Annotated[
    str, Path(min_length=1, max_length=100, examples=["team-blue"], description="Name of the owner who is a guest.")
]


@router.post("/worlds/{identifier}/invitations", status_code=201, responses=problems(403, 404, 409, 413))
async def invite_to_world(
    identifier: Identifier, order: WorldInvitationRequest, caller: Submitter, services: ServicesOf
) -> WorldInvitationView:
    """Makes a code with which the workers of one other owner may join a live world.

    The guest sees the world and its record, and may not control it.
    """
    world = await live_world(services, caller, identifier)
    names = [mission.name for mission in world.order.scenario.missions]
    if unknown := [ego for ego in order.egos or [] if ego not in names]:
        raise InvalidInputError(f"egos: expected some of {names[:50]}, got {unknown[:10]}")
    return WorldInvitationView(world=identifier, code=world.guests.invite(order.egos, coupled=order.coupled))


@router.get("/worlds/{identifier}/guests", responses=problems(403, 404))
def list_guests(
    identifier: Identifier, caller: Holder, services: ServicesOf, limit: Limit = 100, after: After = None
) -> Page[WorldGuestView]:
    """Lists the guests of a world of yours, live or not."""
    with services.database.reading() as session:
        world_of(session, caller, identifier, own=True)
        rows = queries.list_guests(session, identifier, limit + 1, after)
    items = [WorldGuestView(owner=row.owner, admitted=row.admitted) for row in rows[:limit]]
    return Page(items=items, next=items[-1].owner if len(rows) > limit else None)


@router.delete("/worlds/{identifier}/guests/{owner}", status_code=204, responses=problems(403, 404))
async def dismiss_guest(identifier: Identifier, owner: GuestName, caller: Submitter, services: ServicesOf) -> None:
    """Dismisses a guest of a world of yours, live or not: it sees the world and its record no more.

    Its workers lose their places as if they left, and its event streams end. No code that was made before admits it
    again; one that is made later does.
    """
    await dismiss(services, caller, identifier, owner)
