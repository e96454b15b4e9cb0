"""Files that are named by their content hash: several rows may name one, and it goes with the last of them.

A file is added before its row and removed after it. The code that adds or removes one holds its lock and looks at the
rows again, so that no file goes that a new row needs. One server has the database, so locks of its process suffice.
"""

from __future__ import annotations

import threading
from typing import Final

_LOCKS: Final = tuple(threading.Lock() for _ in range(64))


def file_lock(content_hash: str) -> threading.Lock:
    """Lock of the files with this content hash; others may share it."""
    return _LOCKS[hash(content_hash) % len(_LOCKS)]
