"""Audience: the spectators of one world, who share the latest events and keep nobody waiting."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from typing import Final, NamedTuple

from dohyo.service.errors import TooManyRequestsError

HEARTBEAT_S: Final = 15.0
RETRY_MS: Final = 3000
FULL_RETRY_S: Final = 30.0


class Spectator(NamedTuple):
    """A spectator of a world.

    Attributes:
        token_id: API token with which it watches; "": none.
        owner: Owner of the token.
    """

    token_id: str = ""
    owner: str = ""


NOBODY: Final = Spectator()


class Audience:
    """Spectators of a world.

    Each event is encoded once, and only the latest of each name is kept: a spectator that reads slowly misses scenes,
    and costs no memory.
    """

    def __init__(self, watch: Callable[[bool], None], most: int) -> None:
        """Begins without spectators.

        Args:
            watch: Called with whether anybody watches, when that changes.
            most: Most spectators at once.
        """
        self._watch, self._most = watch, most
        self._latest: dict[str, tuple[int, bytes]] = {}
        self._number, self._told_s = 0, 0.0
        self._ended = False
        self._waiting: dict[asyncio.Event, Spectator] = {}

    @property
    def watching(self) -> int:
        """Number of spectators."""
        return len(self._waiting)

    def tell(self, name: str, data: bytes) -> None:
        """Tells an event to all spectators.

        Args:
            name: Name of the event.
            data: JSON in one line.
        """
        self._number += 1
        self._latest[name] = self._number, b"event: %s\ndata: %s\n\n" % (name.encode(), data)
        self._wake(time.monotonic())

    def beat(self, now: float) -> None:
        """Wakes all spectators after silence, so that a connection that is dead is noticed; called again and again.

        One clock for all: a time limit on each wait would cost more than the scenes do.
        """
        if now - self._told_s > HEARTBEAT_S:
            self._wake(now)

    def _wake(self, now: float) -> None:
        self._told_s = now
        for fresh in self._waiting:
            fresh.set()

    def end(self, data: bytes) -> None:
        """Tells that the world has ended, as the last event."""
        self._latest.pop("scene", None)
        self._latest.pop("plans", None)
        self._ended = True
        self.tell("end", data)

    @property
    def token_ids(self) -> set[str]:
        """API tokens with which spectators watch."""
        return {one.token_id for one in self._waiting.values()} - {""}

    def dismiss(self, may_not_watch: Callable[[Spectator], bool]) -> None:
        """Ends the events of spectators that may not watch any more."""
        for fresh in [one for one, spectator in self._waiting.items() if may_not_watch(spectator)]:
            del self._waiting[fresh]
            fresh.set()

    def check_room(self) -> None:
        """Raises TooManyRequestsError if there is no room for another spectator."""
        if len(self._waiting) >= self._most:
            raise TooManyRequestsError(f"the world has its {self._most} spectators", FULL_RETRY_S)

    async def events(
        self, spectator: Spectator = NOBODY, may_watch: Callable[[], bool] = lambda: True
    ) -> AsyncIterator[bytes]:
        """The events for one new spectator, until the world has ended; comments in silence.

        Args:
            spectator: Who watches.
            may_watch: Asked when the events begin, which is later than the request was found allowed.
        """
        if not may_watch():
            return
        fresh, seen = asyncio.Event(), 0
        self._join(fresh, spectator)
        try:
            yield b"retry: %d\n\n" % RETRY_MS
            while fresh in self._waiting:
                latest = sorted(self._latest.values())  # what was kept for nobody may be older than what came since
                events = b"".join(event for number, event in latest if number > seen)
                seen, over = self._number, self._ended
                fresh.clear()
                yield events or b": still here\n\n"
                if over:
                    return
                await fresh.wait()
        finally:
            self._leave(fresh)

    def _join(self, fresh: asyncio.Event, spectator: Spectator) -> None:
        self._waiting[fresh] = spectator
        if len(self._waiting) == 1 and not self._ended:
            self._watch(True)

    def _leave(self, fresh: asyncio.Event) -> None:
        self._waiting.pop(fresh, None)
        if not self._waiting and not self._ended:
            self._watch(False)
            self._latest = {name: told for name, told in self._latest.items() if name == "state"}  # the rest is old
