"""Lock: only one process at a time writes to a folder of results."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from dohyo.sumo_networks.errors import InvalidInputError

_NOT_WRITABLE = (errno.EACCES, errno.EPERM, errno.EROFS)


@contextmanager
def held(folder: Path, what: str = "folder", *, read_only: bool = False) -> Iterator[None]:
    """Makes a folder and keeps other processes out of it until the block, or this process, ends.

    Args:
        folder: Folder to lock.
        what: Name of the folder in an error.
        read_only: Whether a folder in which this process may not write will do; nothing is locked then.

    Raises:
        InvalidInputError: The folder cannot be made or written, or another process holds it.
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
        if not (read_only and folder.is_dir() and error.errno in _NOT_WRITABLE):
            raise InvalidInputError(f"{what} '{folder}' cannot be used: {error.strerror}") from error
    try:
        yield
    finally:
        lock.release()
