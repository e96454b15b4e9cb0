"""Answering: one answer to all requests that wait for it."""

from __future__ import annotations

import asyncio
from typing import TypeVar

from dohyo.service.wire.bodies import Reply

R = TypeVar("R", bound=Reply)


def answer_all(waiting: list[asyncio.Future[R]], answer: R | Exception) -> None:
    """Answers all requests that wait, and empties their list."""
    for future in waiting:
        if future.done():  # the request was cancelled
            continue
        if isinstance(answer, Exception):
            future.set_exception(answer)
        else:
            future.set_result(answer)
    waiting.clear()
