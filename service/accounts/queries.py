"""Tokens: bearer secrets, stored as hashes only."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Sequence
from datetime import datetime, timedelta

from sqlalchemy import ColumnElement, delete, func, select
from sqlalchemy.orm import Session

from dohyo.service.accounts.model import Role, Token
from dohyo.service.database.base import new_id, now
from dohyo.service.database.engine import serialise

PREFIX = "dohyo_"
FIRST_OWNER = "admin"


def create_token(session: Session, owner: str, role: Role, expires_in: timedelta | None = None) -> tuple[Token, str]:
    """Creates a token.

    Returns:
        The row, and the secret, which is not stored.
    """
    secret = PREFIX + secrets.token_urlsafe(32)
    created = now()
    expires = created + expires_in if expires_in is not None else None
    token = Token(
        id=new_id("tok"), owner=owner, role=role, sha256=_digest(secret), created=created, expires=expires, revoked=None
    )
    session.add(token)
    session.flush()
    return token, secret


def first_admin_token(session: Session) -> str | None:
    """Secret of a new administrator's token, if the database held no token."""
    serialise(session)
    if session.scalar(select(func.count()).select_from(Token)):
        return None
    return create_token(session, FIRST_OWNER, Role.ADMIN)[1]


def find_token(session: Session, secret: str, at: datetime | None = None) -> Token | None:
    """Token of a secret, if it is neither expired nor revoked.

    The search uses the secret's hash, so that its duration reveals nothing about similar secrets.
    """
    digest = _digest(secret)
    token = session.scalar(select(Token).where(Token.sha256 == digest))
    if token is None or not hmac.compare_digest(token.sha256, digest):
        return None
    return token if is_valid(token, at) else None


def is_valid(token: Token | None, at: datetime | None = None) -> bool:
    """Whether a token exists, and is neither revoked nor expired."""
    if token is None or token.revoked is not None:
        return False
    return token.expires is None or (at or now()) < token.expires


def list_tokens(
    session: Session, limit: int | None = None, after: str | None = None, owner: str | None = None
) -> Sequence[Token]:
    """Tokens by identifier, those past `after`; of one owner, or of all."""
    query = select(Token).order_by(Token.id)
    query = query.where(Token.owner == owner) if owner is not None else query
    return session.scalars((query.where(Token.id > after) if after else query).limit(limit)).all()


def count_valid_tokens(session: Session, owner: str) -> int:
    """Number of an owner's tokens that are neither expired nor revoked."""
    query = select(func.count()).select_from(Token).where(Token.owner == owner, _valid())
    return session.scalar(query) or 0


def forget_ended_tokens(session: Session, owner: str, kept: int) -> None:
    """Deletes an owner's expired and revoked tokens, except those that ended last.

    Args:
        session: To write in.
        owner: Owner of the tokens.
        kept: Number of ended tokens that stay.
    """
    ended = func.coalesce(Token.revoked, Token.expires)
    old = select(Token.id).where(Token.owner == owner, ~_valid()).order_by(ended.desc(), Token.id).offset(kept)
    session.execute(delete(Token).where(Token.id.in_(old)))


def revoke_token(session: Session, token_id: str) -> Token | None:
    """Revokes a token for ever; None for an unknown one."""
    token = session.get(Token, token_id)
    if token is not None and token.revoked is None:
        token.revoked = now()
    return token


def _valid() -> ColumnElement[bool]:
    """Condition: the token is neither revoked nor expired; never NULL, so that it can be negated."""
    return Token.revoked.is_(None) & (Token.expires.is_(None) | (Token.expires > now()))


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "surrogateescape")).hexdigest()
