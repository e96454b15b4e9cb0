"""Lock: only one process at a time writes to a folder of results."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from dohyo.sumo_networks.errors import InvalidInputError


@contextmanager
def held(folder: Path, what: str = "folder") -> Iterator[None]:
    """Makes a folder and keeps other processes out of it until the block, or this process, ends.

    Args:
        folder: Folder to lock.
        what: Name of the folder in an error.

    Raises:
        InvalidInputError: The folder cannot be made, or another process holds it.
    """
    lock = FileLock(folder / ".lock", blocking=False)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout as error:
        raise InvalidInputError(
            f"{what} '{folder}' is in use by another process: wait until it ends, or choose another folder"
        ) from error
    except OSError as error:
        raise InvalidInputError(f"{what} '{folder}' cannot be used: {error.strerror}") from error
    try:
        yield
    finally:
        lock.release()
