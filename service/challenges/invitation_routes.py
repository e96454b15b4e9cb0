"""Invitations: made, listed and revoked by organisers, redeemed by participants."""

from __future__ import annotations

from datetime import timedelta

from fastapi import APIRouter

from dohyo.service.accounts.access import Identified, Organiser
from dohyo.service.accounts.model import Role
from dohyo.service.accounts.queries import create_token
from dohyo.service.challenges import invitations
from dohyo.service.challenges.orders import InvitationOrder, Redemption
from dohyo.service.challenges.routes import Name, organised
from dohyo.service.challenges.views import InvitationView, NewInvitation, RedeemedView, view_invitation
from dohyo.service.database.engine import serialise
from dohyo.service.errors import ForbiddenError, TooManyRequestsError
from dohyo.service.state import ServicesOf
from dohyo.service.web.bodies.strict_route import StrictRoute
from dohyo.service.web.documents import After, Identifier, Limit, problems
from dohyo.service.web.views import Page
from dohyo.sumo_networks.errors import InvalidInputError

router = APIRouter(prefix="/v1", tags=["challenges"], route_class=StrictRoute)

OPEN_INVITATIONS = 500
MAY_ENTER = (Role.SUBMITTER, Role.ORGANISER)
"""Roles whose tokens may take part; administrators see the seeds of secret phases."""


@router.post("/challenges/{name}/invitations", status_code=201, responses=problems(403, 404, 413, 507))
def create_invitation(name: Name, order: InvitationOrder, caller: Organiser, services: ServicesOf) -> NewInvitation:
    """Makes a code that admits one participant, once; the answer holds it, and it cannot be read again."""
    with services.database.session() as session:
        serialise(session)
        challenge = organised(session, caller, name)
        if invitations.count_open_invitations(session, challenge) >= OPEN_INVITATIONS:
            raise TooManyRequestsError(f"at most {OPEN_INVITATIONS} open invitations; revoke some", retry_s=3600)
        lifetime = timedelta(days=order.expires_in_days)
        invitation, code = invitations.add_invitation(session, challenge, order.team, order.note, lifetime)
    return NewInvitation(**view_invitation(invitation).model_dump(), code=code)


@router.get("/challenges/{name}/invitations", responses=problems(403, 404))
def list_invitations(
    name: Name, caller: Organiser, services: ServicesOf, limit: Limit = 100, after: After = None
) -> Page[InvitationView]:
    """Lists the invitations of a challenge, without their codes."""
    with services.database.reading() as session:
        challenge = organised(session, caller, name)
        rows = invitations.list_invitations(session, challenge, limit + 1, after)
    items = [view_invitation(one) for one in rows[:limit]]
    return Page(items=items, next=items[-1].id if len(rows) > limit else None)


@router.delete("/challenges/{name}/invitations/{identifier}", status_code=204, responses=problems(403, 404, 409))
def revoke_invitation(name: Name, identifier: Identifier, caller: Organiser, services: ServicesOf) -> None:
    """Revokes an invitation that was not redeemed."""
    with services.database.session() as session:
        serialise(session)
        invitations.revoke_invitation(session, organised(session, caller, name), identifier)


@router.post("/invitations/redeem", status_code=201, responses=problems(403, 404, 409, 413, 507))
def redeem_invitation(order: Redemption, caller: Identified, services: ServicesOf) -> RedeemedView:
    """Takes part in a challenge: with a token as its owner; without one as a new owner, who gets a submitter's token.

    A code works once. Members of a team order runs with their own tokens, and each run counts for the team.
    """
    if caller is not None and caller.role not in MAY_ENTER:
        raise ForbiddenError(f"expected a token of role submitter or none, yours is {caller.role}")
    if (caller is None) == (order.owner is None):
        raise InvalidInputError("owner: expected a new owner's name where no token is sent, and none beside a token")
    with services.database.session() as session:
        serialise(session)
        invitation = invitations.find_open_invitation(session, order.code)
        token = None
        if caller is None:
            owner = order.owner or ""
            invitations.check_new_owner(session, invitation, owner)
            token = create_token(session, owner, Role.SUBMITTER)[1]
        else:
            owner = caller.owner
        challenge, team = invitations.redeem(session, invitation, owner, order.team)
        return RedeemedView(challenge=challenge.name, team=team.name, owner=owner, token=token)
