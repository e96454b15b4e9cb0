"""Disk room: blocks for sparse files that are memory-mapped.

A write into a hole of such a file on a full disk ends the process by SIGBUS. So the room is checked before a run
begins, and blocks are reserved before they are written.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from pathlib import Path

from dohyo.sumo_networks.errors import InvalidInputError

BLOCK = 512
"""Unit of `st_blocks`, bytes."""


def check_disk_room(folder: Path, needed: int, remedy: str) -> None:
    """Checks that the disk has room for what a folder will hold.

    Args:
        folder: Folder, which may not exist yet; blocks that its files already have count.
        needed: Bytes that it will hold.
        remedy: What the user can change.

    Raises:
        InvalidInputError: The disk has less room.
    """
    missing = needed - _allocated(folder)
    free = shutil.disk_usage(_existing(folder)).free
    if missing > free:
        raise InvalidInputError(
            f"the disk of '{folder}' is too full: expected {missing:,} bytes free, got {free:,}; {remedy}"
        )


def reserve(files: Iterable[tuple[Path, int, int]]) -> None:
    """Reserves the blocks of a range of files; what they hold is kept. Does nothing where a system cannot.

    Args:
        files: Each with its first byte, and the number of bytes.

    Raises:
        OSError: The disk is full.
    """
    if not hasattr(os, "posix_fallocate"):  # macOS
        return
    for path, first, count in files:
        with path.open("r+b") as file:
            try:
                os.posix_fallocate(file.fileno(), first, count)
            except OSError as error:
                raise OSError(error.errno, os.strerror(error.errno or 0), str(path)) from error


def _allocated(folder: Path) -> int:
    return sum(path.stat().st_blocks * BLOCK for path in folder.rglob("*") if path.is_file())


def _existing(folder: Path) -> Path:
    """The folder, or the first one above it that exists."""
    return next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
