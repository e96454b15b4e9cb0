"""Lock: a folder of results is written by one process at a time."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dohyo.sumo_networks.errors import InvalidInputError


@contextmanager
def held(folder: Path, what: str = "folder") -> Iterator[None]:
    """Makes a folder and keeps others out of it until the block, or this process, ends.

    Args:
        folder: Which.
        what: What to call it in an error.

    Raises:
        InvalidInputError: It cannot be made, or is held already.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / ".lock").open("w")
    except OSError as error:
        raise InvalidInputError(f"{what} '{folder}' cannot be used: {error.strerror}") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise InvalidInputError(f"{what} '{folder}' is in use by another process") from error
        yield
