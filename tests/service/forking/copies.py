"""Programs of copies; this module imports nothing that opens files or sets variables."""

from __future__ import annotations

import json
import os
import signal


def tell(answer: int) -> None:
    """What the copy sees of itself."""
    files = [int(name) for name in os.listdir("/proc/self/fd") if os.path.exists(f"/proc/self/fd/{name}")]
    own = {"files": files, "answer": answer, "variables": dict(os.environ), "folder": os.getcwd()}
    os.write(answer, json.dumps(own | {"leader": os.getsid(0) == os.getpid()}).encode())


def stay(answer: int) -> None:
    """Waits for a signal."""
    os.write(answer, b"here")
    signal.pause()
