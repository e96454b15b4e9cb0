"""Progress: an evaluation's events as server-sent events (text/event-stream)."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Awaitable, Callable

from dohyo.service.evaluations.views import EvaluationView
from dohyo.service.state import Broadcast

MEDIA_TYPE = "text/event-stream"
HEARTBEAT_S = 15.0
RETRY_MS = 3000


async def stream_progress(
    events: Broadcast, evaluation_id: str, read: Callable[[], Awaitable[EvaluationView]]
) -> AsyncIterator[str]:
    """Streams the events of one evaluation until it ends.

    Args:
        events: Broadcast of the service.
        evaluation_id: Identifier of the evaluation.
        read: Reads the whole state; it is read after listening has begun, so that no event is missed, and again
            whenever this reader was too slow to get all events.

    Yields:
        `state` (the whole evaluation) first, `episode` for each change, `end` (the whole evaluation) last; comments in
        between, so that a connection that is dead is noticed.
    """
    with events.subscribe(f"evaluation:{evaluation_id}") as subscription:
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
