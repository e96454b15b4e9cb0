"""Shielding: work that a cancellation does not cut off, since half of it would leave a process or a file behind."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


async def to_the_end(work: Coroutine[Any, Any, T]) -> T:
    """Awaits work, also while it is cancelled: the cancellation is raised once the work has ended.

    `asyncio.shield` raises it at once, and leaves the work to itself.

    Raises:
        CancelledError: It was cancelled meanwhile; a failure of the work is its cause.
    """
    task, cancelled = asyncio.create_task(work), False
    while not task.done():
        try:
            await asyncio.wait([task])
        except asyncio.CancelledError:
            cancelled = True
    if cancelled:
        raise asyncio.CancelledError from (None if task.cancelled() else task.exception())
    return task.result()
