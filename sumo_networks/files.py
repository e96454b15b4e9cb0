"""Atomic files: written under a temporary name, flushed to the disk, then renamed."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4


@contextmanager
def staged(path: Path) -> Iterator[Path]:
    """Temporary path to write to; it replaces `path` when the block ends without an error.

    The file at `path` is either unchanged or complete, even if the machine stops half-way. Temporary names begin with a
    dot, so that listings of results ignore them.

    Args:
        path: Final path; its folder exists.

    Raises:
        OSError: The file cannot be written.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.{uuid4().hex[:8]}.tmp")
    try:
        yield draft
        _flush(draft)
        os.replace(draft, path)
        _flush(path.parent)
    finally:
        draft.unlink(missing_ok=True)


def write_atomically(path: Path, content: bytes) -> None:
    """Writes a file that is either unchanged or complete; see `staged`.

    Raises:
        OSError: The file cannot be written.
    """
    with staged(path) as draft:
        draft.write_bytes(content)


def read_lines(path: Path) -> list[dict[str, Any]]:
    """JSON objects of a file, one per line; a line that is incomplete after an interrupted write is left out.

    Returns:
        The objects in the order of the lines; empty if there is no file.
    """
    found = []
    for text in path.read_text().splitlines() if path.exists() else ():
        try:
            found.append(json.loads(text))
        except json.JSONDecodeError:
            continue
    return found


def _flush(path: Path) -> None:
    """Waits until a file's bytes, or a folder's names, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
