"""Turns: which owner is served next, fairly by the processor seconds that each has used.

Start-time fair queuing (Goyal, Vin and Cheng, 1997): the owner with the least used seconds is next; an owner who comes
back begins where the least of the others is, so that idle time earns no credit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

EXPECTED_S = 10.0  # charged for a turn until its real use is known


class Owned(Protocol):
    """Anything with an owner."""

    @property
    def owner(self) -> str:
        """Owner whose share it uses."""


T = TypeVar("T", bound=Owned)


@dataclass(slots=True)
class Turns:
    """Use of a service by owner.

    Attributes:
        used_s: Charged seconds by owner.
        running: Turns that have begun and not ended, by owner.
    """

    used_s: dict[str, float] = field(default_factory=dict)
    running: Counter[str] = field(default_factory=Counter)
    _count: int = 0
    _last: dict[str, int] = field(default_factory=dict)
    _active: set[str] = field(default_factory=set)

    def next(self, candidates: Sequence[T]) -> T:
        """The first candidate of the owner who used least; of equals, of the one served longest ago."""
        self._admit({one.owner for one in candidates})
        return min(candidates, key=lambda one: (self.used_s[one.owner], self._last.get(one.owner, 0)))

    def begin(self, owner: str) -> None:
        """An owner's turn begins, charged as expected."""
        self._count += 1
        self._last[owner] = self._count
        self.used_s[owner] = self.used_s.get(owner, 0.0) + EXPECTED_S
        self.running[owner] += 1

    def end(self, owner: str, seconds: float) -> None:
        """An owner's turn has ended and used so many processor seconds."""
        self.used_s[owner] = self.used_s.get(owner, 0.0) + seconds - EXPECTED_S
        self.running[owner] -= 1
        self.running += Counter()  # drops zeros

    def _admit(self, waiting: set[str]) -> None:
        """Owners who were idle begin at the least use of the others."""
        active = waiting | set(self.running)
        if not self._active:
            self.used_s.clear()  # all were idle: nobody is owed anything
        floor = min((self.used_s[owner] for owner in active & self._active), default=0.0)
        for owner in active - self._active:
            self.used_s[owner] = max(self.used_s.get(owner, 0.0), floor)
        self._active = active
