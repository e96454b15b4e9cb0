"""Guests of a world: owners who join the world of another one by an invitation."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from dohyo.service.errors import ForbiddenError, NotFoundError, TooManyRequestsError

PREFIX: Final = "dohyo_world_"
MOST_INVITATIONS: Final = 100


@dataclass(slots=True)
class Invitation:
    """What one guest may do.

    Attributes:
        number: Of the world's invitations, from 1.
        egos: Egos that the guest may drive; None: all.
        coupled: Whether the guest may couple a simulator.
        owner: The guest; None: nobody has used the invitation.
    """

    number: int
    egos: tuple[str, ...] | None
    coupled: bool
    owner: str | None = None


class Guests:
    """Invitations to a live world, by the hash of their code."""

    def __init__(self) -> None:
        """Begins with none."""
        self._invitations: dict[str, Invitation] = {}
        self._made = 0
        self._dismissed: dict[str, int] = {}  # by owner: number of the last invitation before the dismissal

    def invite(self, egos: Sequence[str] | None, *, coupled: bool) -> str:
        """Makes an invitation for one owner; returns its code.

        Raises:
            TooManyRequestsError: There are too many.
        """
        if len(self._invitations) >= MOST_INVITATIONS:
            raise TooManyRequestsError(f"at most {MOST_INVITATIONS} invitations to one world", retry_s=3600)
        code = PREFIX + secrets.token_urlsafe(24)
        self._made += 1
        self._invitations[_digest(code)] = Invitation(self._made, None if egos is None else tuple(egos), coupled)
        return code

    def admit(self, code: str, owner: str) -> None:
        """Admits an owner; a code is for the first one who sends it.

        Raises:
            NotFoundError: There is no such invitation, another owner has used it, or it is older than the dismissal of
                this one.
        """
        invitation = self._invitations.get(_digest(code))
        if (
            invitation is None
            or invitation.owner not in (None, owner)
            or invitation.number <= self._dismissed.get(owner, 0)
        ):
            raise NotFoundError("no open invitation to this world has this code: it is unknown, or was used")
        invitation.owner = owner

    def has(self, owner: str) -> bool:
        """Whether an owner was admitted, and not dismissed since."""
        return any(one.owner == owner for one in self._invitations.values())

    def dismiss(self, owner: str) -> None:
        """Forgets the invitations of a guest; it may use only those that are made from now on."""
        self._dismissed[owner] = self._made
        self._invitations = {digest: one for digest, one in self._invitations.items() if one.owner != owner}

    def check(self, owner: str, egos: Sequence[str], *, coupled: bool) -> None:
        """Refuses what no invitation of a guest allows.

        Raises:
            ForbiddenError: The guest was not invited to that.
        """
        for one in self._invitations.values():
            if one.owner == owner and (one.coupled or not coupled) and (one.egos is None or set(egos) <= set(one.egos)):
                return
        what = f"to drive {list(egos)}" + (" with a simulator that is coupled" if coupled else "")
        raise ForbiddenError(f"your invitation to this world does not allow {what}")


def _digest(code: str) -> str:
    return hashlib.sha256(code.encode("utf-8", "surrogateescape")).hexdigest()
