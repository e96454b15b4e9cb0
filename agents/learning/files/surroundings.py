"""Surroundings of a session: the command, the code's commit, versions of libraries, the machine.

A file of its own, since a table of stored results is read without torch.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = ("dohyo", "torch", "torchrl", "tensordict", "numpy", "gymnasium", "libsumo")


def surroundings() -> dict[str, Any]:
    """Facts of a session: commit, versions, host."""
    # An installed dohyo may lie in the folder of another repository, which does not have this file.
    ours = _git("ls-files", "--error-unmatch", "--", Path(__file__).name) is not None
    return {
        "command": sys.argv,
        "commit": _git("rev-parse", "HEAD") if ours else None,
        "uncommitted": ours and (status := _git("status", "--porcelain")) is not None and status != "",
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in PACKAGES},
        "host": platform.node(),
        "system": platform.platform(),
        "cores": os.cpu_count(),
        "started": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }


def _git(*arguments: str) -> str | None:
    """What git says in the folder that this code is in; None without git or repository, or where it fails."""
    try:
        command = ["git", "-C", str(Path(__file__).parent), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
