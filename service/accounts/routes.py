"""Tokens: made, listed and revoked by administrators."""

from __future__ import annotations

from datetime import timedelta
from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field

from dohyo.service.accounts import queries as tokens
from dohyo.service.accounts.access import Admin, Holder
from dohyo.service.accounts.model import Role
from dohyo.service.accounts.views import MeView, NewToken, TokenView, view_token
from dohyo.service.errors import NotFoundError
from dohyo.service.state import ServicesOf
from dohyo.service.web.documents import After, Identifier, Limit, problems
from dohyo.service.web.views import Page

router = APIRouter(prefix="/v1", tags=["tokens"], responses=problems(403))

Owner = Annotated[str, Field(min_length=1, max_length=100, pattern=r"^[A-Za-z0-9][A-Za-z0-9._@-]*$")]


class TokenOrder(BaseModel):
    """The owner and the role of a new token."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={"examples": [{"owner": "team-blue", "role": "submitter", "expires_in_days": 90}]},
    )

    owner: Owner
    role: Role
    expires_in_days: Annotated[float | None, Field(gt=0, le=3650)] = None


@router.post("/tokens", status_code=201, responses=problems(403, 413, 507))
def create_token(order: TokenOrder, caller: Admin, services: ServicesOf) -> NewToken:
    """Creates a token; the answer holds its secret, which cannot be read again."""
    lifetime = timedelta(days=order.expires_in_days) if order.expires_in_days is not None else None
    with services.database.session() as session:
        token, secret = tokens.create_token(session, order.owner, order.role, lifetime)
    return NewToken(**view_token(token).model_dump(), token=secret)


@router.get("/tokens")
def list_tokens(caller: Admin, services: ServicesOf, limit: Limit = 100, after: After = None) -> Page[TokenView]:
    """Lists tokens, without their secrets."""
    with services.database.reading() as session:
        rows = tokens.list_tokens(session, limit + 1, after)
    items = [view_token(token) for token in rows[:limit]]
    return Page(items=items, next=items[-1].id if len(rows) > limit else None)


@router.delete("/tokens/{identifier}", status_code=204, responses=problems(403, 404))
def revoke_token(identifier: Identifier, caller: Admin, services: ServicesOf) -> None:
    """Revokes a token at once and for ever."""
    with services.database.session() as session:
        if tokens.revoke_token(session, identifier) is None:
            raise NotFoundError(f"no token '{identifier}'")


@router.get("/me")
def get_me(caller: Holder) -> MeView:
    """Owner and role of the caller's token."""
    return MeView(owner=caller.owner, role=caller.role, token=caller.token_id or "")
