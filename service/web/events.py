"""Events: the life of an evaluation or a job as server-sent events (text/event-stream)."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Protocol

from dohyo.service.state import Broadcast

MEDIA_TYPE = "text/event-stream"
HEARTBEAT_S = 15.0
RETRY_MS = 3000


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


async def stream(events: Broadcast, topic: str, read: Callable[[], Awaitable[State]]) -> AsyncIterator[str]:
    """Streams the events of one topic until what it is about ends.

    Args:
        events: Broadcast of the service.
        topic: Such as "evaluation:ev-9f86d081884c7d65".
        read: Reads the whole state; it is read after listening has begun, so that no event is missed, and again
            whenever this reader was too slow to get all events.

    Yields:
        `state` (the whole state) first and after each change of it, `episode` for each message about an episode, `end`
        (the whole state) last; comments in between, so that a connection that is dead is noticed.
    """
    with events.subscribe(topic) as subscription:
        state = await read()
        yield f"retry: {RETRY_MS}\n" + _event("state", state.model_dump_json())
        while not state.status.finished and not subscription.closed:
            message = await subscription.get(HEARTBEAT_S)
            if message is not None and "episode" in message and not subscription.lagged:
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
