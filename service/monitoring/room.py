"""Room in the data folder: whether an order could be stored."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from dohyo.service.errors import DISK_FULL

NEEDED_BYTES = 1_000_000
"""Room of one order with its journal, bytes; records need more and wait for it."""


def lack_of_room(data: Path) -> str | None:
    """Why nothing can be stored in a folder, in words; None if it can.

    Space for a file without a name is asked for and given back, since quotas are not among the free bytes of a disk.
    """
    try:
        with tempfile.TemporaryFile(dir=data) as file:
            os.posix_fallocate(file.fileno(), 0, NEEDED_BYTES)
    except OSError as error:
        if error.errno in DISK_FULL:
            return "no space is left in the data folder"
        return f"the data folder cannot be written: {error.strerror}"
    return None
