"""Answers of the token routes."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

from pydantic import Field

from dohyo.service.accounts.model import Role, Token
from dohyo.service.web.views import Moment, View


class TokenView(View):
    """A token without its secret."""

    id: Annotated[str, Field(examples=["tok-9f86d081884c7d65"])]
    owner: Annotated[str, Field(examples=["team-blue"])]
    role: Role
    created: Moment
    expires: datetime | None
    revoked: datetime | None


class NewToken(TokenView):
    """A new token; its secret cannot be read again."""

    token: Annotated[str, Field(examples=["dohyo_7Zl3..."])]


class MeView(View):
    """Owner and role of the sent token."""

    owner: str
    role: Role
    token: str


def view_token(token: Token) -> TokenView:
    """View of a token without its secret."""
    return TokenView.model_validate(token, from_attributes=True)
