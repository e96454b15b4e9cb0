"""Invitations: codes that admit one owner each to a challenge, once, until they expire."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Sequence
from datetime import timedelta
from typing import Final

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import InstrumentedAttribute, Session

from dohyo.service.accounts.model import Token
from dohyo.service.challenges.model import Challenge, Invitation, Member, Team
from dohyo.service.database.base import new_id, now
from dohyo.service.errors import ConflictError, ForbiddenError, NotFoundError
from dohyo.service.submissions.model import Agent

PREFIX: Final = "dohyo_invitation_"
OWNERS: Final = (Token.owner, Agent.owner, Challenge.owner, Member.owner)


def add_invitation(
    session: Session, challenge: Challenge, team: str | None, note: str, lifetime: timedelta
) -> tuple[Invitation, str]:
    """Makes an invitation.

    Returns:
        The row, and the code, which is not stored.
    """
    code = PREFIX + secrets.token_urlsafe(24)
    made = now()
    invitation = Invitation(
        id=new_id("in"),
        challenge_id=challenge.id,
        sha256=_digest(code),
        team=team,
        note=note,
        created=made,
        expires=made + lifetime,
    )
    session.add(invitation)
    session.flush()
    return invitation, code


def list_invitations(session: Session, challenge: Challenge, limit: int, after: str | None) -> Sequence[Invitation]:
    """Invitations of a challenge by identifier, those past `after`."""
    query = select(Invitation).where(Invitation.challenge_id == challenge.id).order_by(Invitation.id).limit(limit)
    return session.scalars(query.where(Invitation.id > after) if after else query).all()


def count_open_invitations(session: Session, challenge: Challenge) -> int:
    """Number of a challenge's invitations that can still be redeemed."""
    query = select(func.count()).select_from(Invitation).where(Invitation.challenge_id == challenge.id)
    return session.scalar(query.where(*_is_open())) or 0


def find_open_invitation(session: Session, code: str) -> Invitation:
    """The invitation of a code that can be redeemed now. The search uses the code's hash, as that of tokens does.

    Raises:
        NotFoundError: The code is unknown, used, revoked or expired; the answer does not say which.
    """
    query = select(Invitation).where(Invitation.sha256 == _digest(code)).with_for_update()
    invitation = session.scalar(query)
    if invitation is None or invitation.redeemed or invitation.revoked or invitation.expires <= now():
        raise NotFoundError("no open invitation has this code: it is unknown, used, revoked or expired")
    return invitation


def check_new_owner(session: Session, invitation: Invitation, owner: str) -> None:
    """Refuses the name of an existing owner, whose data a new token would open; case does not matter.

    Args:
        session: To read in.
        invitation: The one that is redeemed: its own team may have the owner's name.
        owner: Name of the new owner.

    Raises:
        ConflictError: An owner has the name, or a team, also one that an open invitation names.
    """
    if _is_in(session, OWNERS, owner):
        raise ConflictError(f"owner '{owner}' exists; choose another name, or send the token of this owner")
    is_own = (invitation.team or "").lower() == owner.lower()
    others = (Invitation.challenge_id != invitation.challenge_id,) if is_own else ()
    if _is_in(session, (Team.name,), owner) or _is_promised(session, owner, *others):
        raise ConflictError(f"a team has the name '{owner}'; choose another name")


def redeem(session: Session, invitation: Invitation, owner: str, team: str | None) -> tuple[Challenge, Team]:
    """Admits an owner to the challenge of an invitation, into the team that it names or a new one. `serialise` first.

    Args:
        session: To write in.
        invitation: An open one.
        owner: Owner to admit.
        team: Name of the new team, where the invitation names none; None: the owner's name.

    Raises:
        ConflictError: The owner is a participant already, or the name of the new team is taken, in an invitation, or
            another owner's.
        ForbiddenError: The owner organises the challenge, and so knows its secrets.
    """
    challenge = session.get_one(Challenge, invitation.challenge_id)
    if owner == challenge.owner:
        raise ForbiddenError("the organiser of a challenge cannot take part; enter agents as baselines")
    if session.get(Member, (challenge.id, owner)) is not None:
        raise ConflictError(f"owner '{owner}' takes part in challenge '{challenge.name}' already")
    if invitation.team is None and team is not None and team.lower() != owner.lower() and _is_in(session, OWNERS, team):
        raise ConflictError(f"an owner has the name '{team}'; choose another name for the team")
    joined = _team(session, challenge, invitation, team or owner)
    session.add(Member(challenge_id=challenge.id, owner=owner, team_id=joined.id))
    invitation.redeemed, invitation.redeemed_by = now(), owner
    session.flush()
    return challenge, joined


def revoke_invitation(session: Session, challenge: Challenge, invitation_id: str) -> None:
    """Revokes an invitation that was not redeemed.

    Raises:
        NotFoundError: The challenge has none of this identifier.
        ConflictError: It was redeemed.
    """
    invitation = session.get(Invitation, invitation_id, with_for_update=True)
    if invitation is None or invitation.challenge_id != challenge.id:
        raise NotFoundError(f"challenge '{challenge.name}' has no invitation '{invitation_id}'")
    if invitation.redeemed is not None:
        raise ConflictError(f"invitation '{invitation_id}' was redeemed by '{invitation.redeemed_by}'")
    invitation.revoked = invitation.revoked or now()


def _team(session: Session, challenge: Challenge, invitation: Invitation, name: str) -> Team:
    wanted = invitation.team or name
    same = (Team.challenge_id == challenge.id, func.lower(Team.name) == wanted.lower())
    team = session.scalar(select(Team).where(*same))
    here = Invitation.challenge_id == challenge.id
    if invitation.team is None and (team is not None or _is_promised(session, wanted, here)):
        raise ConflictError(f"team '{wanted}' exists; choose another name, or ask the organiser for a place in it")
    if team is None:
        team = Team(id=new_id("tm"), challenge_id=challenge.id, name=wanted)
        session.add(team)
        session.flush()
    return team


def _is_in(session: Session, columns: Sequence[InstrumentedAttribute[str]], name: str) -> bool:
    """Whether some column has a name; case does not matter."""
    same = (select(column).where(func.lower(column) == name.lower()).limit(1) for column in columns)
    return any(session.scalar(query) is not None for query in same)


def _is_promised(session: Session, team: str, *where: ColumnElement[bool]) -> bool:
    """Whether an open invitation names a team: another owner who makes it first would get its bearer."""
    named = (func.lower(Invitation.team) == team.lower(), *_is_open())
    return session.scalar(select(Invitation.id).where(*named, *where).limit(1)) is not None


def _is_open() -> tuple[ColumnElement[bool], ...]:
    """Conditions on `Invitation`: it can still be redeemed."""
    return Invitation.redeemed.is_(None), Invitation.revoked.is_(None), Invitation.expires > now()


def _digest(code: str) -> str:
    return hashlib.sha256(code.encode("utf-8", "surrogateescape")).hexdigest()
