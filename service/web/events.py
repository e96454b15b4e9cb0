"""Events: the life of an evaluation or a job as server-sent events (text/event-stream)."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Final, Protocol

from fastapi import Request
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from dohyo.service.errors import TooManyRequestsError
from dohyo.service.state import Broadcast, Services
from dohyo.service.web.addresses import payer_of

MEDIA_TYPE = "text/event-stream"
HEARTBEAT_S = 15.0
RETRY_MS = 3000
STREAMS_PER_CALLER: Final = 32
FULL_RETRY_S = 30.0


class _Status(Protocol):
    @property
    def finished(self) -> bool: ...


class State(Protocol):
    """State of something that ends, as its route answers it."""

    @property
    def status(self) -> _Status:
        """Its status."""

    def model_dump_json(self) -> str:
        """The state as JSON."""


class EventResponse(StreamingResponse):
    """Answer with events. One owner, or one client without a token, has at most `STREAMS_PER_CALLER` open.

    A stream counts from its first byte to its end: the limit of connections closes only those that wait.
    """

    def __init__(self, request: Request, events: AsyncIterator[str] | AsyncIterator[bytes]) -> None:
        """An answer to a request, which counts for its caller."""
        super().__init__(events, media_type=MEDIA_TYPE, headers={"cache-control": "no-store"})
        services: Services = request.app.state.services
        self._open: Counter[str] = services.streams
        self._payer = payer_of(request)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Sends the events.

        Raises:
            TooManyRequestsError: The caller has too many streams open.
        """
        if self._open[self._payer] >= STREAMS_PER_CALLER:
            raise TooManyRequestsError(f"at most {STREAMS_PER_CALLER} open event streams; end some", FULL_RETRY_S)
        self._open[self._payer] += 1
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._open[self._payer] -= 1
            if not self._open[self._payer]:
                del self._open[self._payer]


async def stream(
    events: Broadcast, topic: str, read: Callable[[], Awaitable[State]], *, name_episodes: bool = True
) -> AsyncIterator[str]:
    """Streams the events of one topic until what it is about ends.

    Args:
        events: Broadcast of the service.
        topic: Such as "evaluation:ev-9f86d081884c7d65".
        read: Reads the whole state; it is read after listening has begun, so that no event is missed, and again
            whenever this reader was too slow to get all events.
        name_episodes: Whether the reader may know which episode a message is about; else such a message is a change.

    Yields:
        `state` (the whole state) first and after each change of it, `episode` for each message about an episode, `end`
        (the whole state) last; comments in between, so that a connection that is dead is noticed.
    """
    with events.subscribe(topic) as subscription:
        state = await read()
        yield f"retry: {RETRY_MS}\n" + _event("state", state.model_dump_json())
        while not state.status.finished and not subscription.closed:
            message = await subscription.get(HEARTBEAT_S)
            if name_episodes and message is not None and "episode" in message and not subscription.lagged:
                yield _event("episode", json.dumps(message))
                continue
            if subscription.closed:
                return
            # After silence, an end, or a gap, the state in the database decides.
            subscription.lagged = False
            before, state = state, await read()
            if state.status.finished:
                break
            yield _event("state", state.model_dump_json()) if state != before else ": still here\n\n"
        if state.status.finished:
            yield _event("end", state.model_dump_json(), "end")


def _event(name: str, data: str, identifier: str = "") -> str:
    return f"event: {name}\n" + (f"id: {identifier}\n" if identifier else "") + f"data: {data}\n\n"
