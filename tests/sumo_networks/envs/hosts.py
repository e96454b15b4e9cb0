"""Hosts of worker processes that never answer. They import nothing, since workers load this."""

from __future__ import annotations

import time
from typing import Any

FOR_EVER_S = 100_000.0


class Sleeper:
    """Sleeps when it is asked for anything."""

    def carry_out(self, command: str, *arguments: Any) -> Any:
        time.sleep(FOR_EVER_S)

    def close(self) -> None:
        time.sleep(FOR_EVER_S)


class Imported:
    """Makes a host, from a module whose import takes for ever."""

    def __reduce__(self) -> Any:
        return time.sleep, (FOR_EVER_S,)


def made() -> Sleeper:
    """Never makes it."""
    time.sleep(FOR_EVER_S)
    return Sleeper()
