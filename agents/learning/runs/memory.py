"""Memory of a training: what an update frees is kept for the next one."""

from __future__ import annotations

import ctypes
from typing import Final

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Parameters of mallopt, from glibc's malloc.h."""
KEPT_BYTES: Final = 1 << 30


def keep_freed_memory() -> bool:
    """Makes this process keep up to 1 GiB of freed memory; returns whether its C library can.

    By default glibc gives blocks as large as a batch of pictures back to the kernel, which clears them again for every
    update: up to a third of the time of a training from pictures.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    return (mallopt(_TRIM_THRESHOLD, KEPT_BYTES), mallopt(_MMAP_THRESHOLD, KEPT_BYTES)) == (1, 1)
