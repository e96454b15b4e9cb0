"""Tokens: made, listed and revoked by their owner, and by administrators for all owners."""

from __future__ import annotations

from datetime import timedelta
from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy.orm import Session

from dohyo.service.accounts import queries as tokens
from dohyo.service.accounts.access import Caller, Holder
from dohyo.service.accounts.model import Role, Token
from dohyo.service.accounts.views import MeView, NewToken, TokenView, view_token
from dohyo.service.database.base import now
from dohyo.service.database.engine import serialise
from dohyo.service.errors import ForbiddenError, NotFoundError, TooManyRequestsError
from dohyo.service.state import ServicesOf
from dohyo.service.web.bodies.strict_route import StrictRoute
from dohyo.service.web.documents import After, Identifier, Limit, problems
from dohyo.service.web.spelling import OWNER_NAME
from dohyo.service.web.views import Page

router = APIRouter(prefix="/v1", tags=["tokens"], responses=problems(403), route_class=StrictRoute)

Owner = Annotated[str, Field(min_length=1, max_length=100, pattern=OWNER_NAME)]


PER_OWNER = 50
ENDED_PER_OWNER = 50  # tokens that are still listed after their end


class TokenOrder(BaseModel):
    """The owner and the role of a new token."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={"examples": [{"owner": "team-blue", "role": "submitter", "expires_in_days": 90}]},
    )

    owner: Annotated[Owner | None, Field(description="Default: yourself; another owner only by administrators.")] = None
    role: Annotated[Role, Field(description="Permissions; at most those of the sent token.")]
    expires_in_days: Annotated[
        float | None, Field(gt=0, le=3650, description="Default: never, but not after the sent token.")
    ] = None


@router.post("/tokens", status_code=201, responses=problems(403, 413, 507))
def create_token(order: TokenOrder, caller: Holder, services: ServicesOf) -> NewToken:
    """Creates a token; the answer holds its secret, which cannot be read again.

    Of its owner's expired and revoked tokens the last 50 stay listed.
    """
    owner = order.owner or caller.owner
    if not caller.owns(owner):
        raise ForbiddenError(f"expected your own name '{caller.owner}' as owner, got '{owner}'")
    if not _includes(caller.role, order.role):
        raise ForbiddenError(f"expected a role within yours, '{caller.role}', got '{order.role}'")
    with services.database.session() as session:
        serialise(session)
        if not caller.is_admin and tokens.count_valid_tokens(session, owner) >= PER_OWNER:
            raise TooManyRequestsError(f"at most {PER_OWNER} valid tokens of one owner; revoke some", retry_s=3600)
        token, secret = tokens.create_token(session, owner, order.role, _lifetime(session, caller, order))
        tokens.forget_ended_tokens(session, owner, ENDED_PER_OWNER)
    return NewToken(**view_token(token).model_dump(), token=secret)


@router.get("/tokens")
def list_tokens(caller: Holder, services: ServicesOf, limit: Limit = 100, after: After = None) -> Page[TokenView]:
    """Lists the caller's tokens, an administrator's all, without their secrets."""
    with services.database.reading() as session:
        rows = tokens.list_tokens(session, limit + 1, after, None if caller.is_admin else caller.owner)
    items = [view_token(token) for token in rows[:limit]]
    return Page(items=items, next=items[-1].id if len(rows) > limit else None)


@router.delete("/tokens/{identifier}", status_code=204, responses=problems(403, 404))
def revoke_token(identifier: Identifier, caller: Holder, services: ServicesOf) -> None:
    """Revokes a token at once and for ever: an own one within the caller's role, by an administrator any."""
    with services.database.session() as session:
        token = session.get(Token, identifier)
        if token is None or not caller.owns(token.owner):
            raise NotFoundError(f"no token '{identifier}'")
        if not _includes(caller.role, token.role):
            raise ForbiddenError(f"token '{identifier}' has role '{token.role}', which is above yours")
        tokens.revoke_token(session, identifier)


@router.get("/me")
def get_me(caller: Holder) -> MeView:
    """Owner and role of the caller's token."""
    return MeView(owner=caller.owner, role=caller.role, token=caller.token_id or "")


def _includes(role: Role, other: Role) -> bool:
    """Whether a role has all permissions of another one; `Role` lists the most powerful first."""
    roles = list(Role)
    return roles.index(role) <= roles.index(other)


def _lifetime(session: Session, caller: Caller, order: TokenOrder) -> timedelta | None:
    """Lifetime of a new token: as ordered, but never longer than that of the token that orders it."""
    asked = timedelta(days=order.expires_in_days) if order.expires_in_days is not None else None
    own = session.get(Token, caller.token_id) if caller.token_id else None
    left = own.expires - now() if own is not None and own.expires is not None else None
    return min((one for one in (asked, left) if one is not None), default=None)
