"""Seats: the places of all workers in one world, and what they decide together."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

from dohyo.service.errors import ConflictError, TooManyRequestsError
from dohyo.service.worlds.live.seat import Seat
from dohyo.sumo_networks.errors import InvalidInputError

MOST_NAMED = 50
MOST_WITHOUT_EGOS = 8
"""Places of one owner without an ego in a world; the others are as many as egos at most."""


class Seats:
    """The seats of a world, in the order in which they were taken.

    Attributes:
        drove_all: Whether the last seat ended since the drives of its egos have. The other egos then end theirs.
    """

    def __init__(self, egos: Sequence[str]) -> None:
        """Begins with none.

        Args:
            egos: All egos of the world.
        """
        self._egos = tuple(egos)
        self._seats: dict[str, Seat] = {}
        self.drove_all = False

    def __len__(self) -> int:
        return len(self._seats)

    def __iter__(self) -> Iterator[Seat]:
        """The present seats; one may be removed during the loop."""
        return iter(list(self._seats.values()))

    def add(self, seat: Seat) -> None:
        """Adds a seat, or keeps it."""
        self._seats[seat.id], self.drove_all = seat, False

    def remove(self, seat: Seat, why: str, *, driven: bool = False) -> None:
        """Removes a seat, if it is there, and tells it why; `driven`: its egos have ended their drives."""
        self._seats.pop(seat.id, None)
        self.drove_all = driven and not self._seats
        seat.end(why)

    def restart(self) -> None:
        """The world begins anew: nothing is decided, and without seats it stands still."""
        self.drove_all = False
        for seat in self:
            seat.restart()

    def named(self, name: str) -> Seat | None:
        """The seat of a worker."""
        return next((seat for seat in self if seat.spec.name == name), None)

    @property
    def drivers(self) -> dict[str, str]:
        """Names of the workers by ego, of egos that have one."""
        return {ego: seat.spec.name for seat in self for ego in seat.egos}

    @property
    def coupled(self) -> bool:
        """Whether any of them couples a simulator."""
        return any(seat.coupled for seat in self)

    @property
    def silent(self) -> list[Seat]:
        """Those that have not decided."""
        return [seat for seat in self if seat.decision is None]

    def decisions(self, driving: Collection[str]) -> dict[str, Any]:
        """Decisions by ego, of egos that still drive."""
        decided = {ego: action for seat in self for ego, action in (seat.decision or {}).items()}
        return {ego: action for ego, action in decided.items() if ego in driving}

    def renew(self, due: float) -> None:
        """All decisions are due at a time of the loop."""
        for seat in self:
            seat.due = due

    def check_free(self, seat: Seat, before: Seat | None, driving: Collection[str]) -> None:
        """Checks that a worker may take its egos.

        Args:
            seat: Its place to be.
            before: The place that it has under its name.
            driving: Egos that still drive.

        Raises:
            InvalidInputError: There is no such ego.
            ConflictError: An ego has ended its drive, or another worker drives it or has the name.
            TooManyRequestsError: Its owner has too many places without an ego.
        """
        if before is not None and before.owner != seat.owner:
            raise ConflictError(f"another owner's worker has the name '{seat.spec.name}' in this world")
        others = [one for one in self if one is not before and one.owner == seat.owner and not one.egos]
        if not seat.egos and len(others) >= MOST_WITHOUT_EGOS:
            most = f"at most {MOST_WITHOUT_EGOS} places without an ego of one owner in a world"
            raise TooManyRequestsError(f"expected {most}; leave one", retry_s=60)
        held = {ego: one for one in self if one is not before for ego in one.egos}
        for ego in seat.egos:
            if ego not in self._egos:
                raise InvalidInputError(f"egos: expected some of {list(self._egos[:MOST_NAMED])}, got '{ego[:100]}'")
            if ego in held:
                raise ConflictError(f"ego '{ego}' has a driver: '{held[ego].spec.name}'")
            if ego not in driving and (before is None or ego not in before.egos):
                raise ConflictError(f"ego '{ego}' has ended its drive")
