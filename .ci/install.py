"""Installs dohyo and its tools with the Python that runs this: `.venv/bin/python .ci/install.py`. `make setup` does.

PyPI's torch for Linux requires CUDA's libraries, some gigabytes. Where there is no GPU and PyTorch's index of CPU
builds answers, torch comes from there; else from wherever pip finds it.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Mapping
from pathlib import Path

CPU_INDEX = "https://download.pytorch.org/whl/cpu"
ANSWER_WITHIN_S = 4.0
COMMAND = ("-m", "pip", "install", "-qq", "--no-input", "--disable-pip-version-check", "--no-compile")
WHAT = "dohyo's libraries and tools (about 150 packages, 600 MB)"


def has_gpu() -> bool:
    """Whether NVIDIA's driver is here."""
    return shutil.which("nvidia-smi") is not None or Path("/proc/driver/nvidia/version").exists()


def answers(index: str, within_s: float = ANSWER_WITHIN_S) -> bool:
    """Whether a package index knows torch; a name that does not resolve and a server that hangs count as no."""
    found = threading.Event()

    def ask() -> None:
        try:
            with urllib.request.urlopen(f"{index}/torch/", timeout=within_s) as reply:
                if reply.status == 200:
                    found.set()
        except (OSError, ValueError, urllib.error.URLError):
            pass

    thread = threading.Thread(target=ask, daemon=True)  # a look-up of a name cannot be timed out
    thread.start()
    thread.join(within_s)
    return found.is_set()


def plan(environment: Mapping[str, str], index: str = CPU_INDEX) -> tuple[dict[str, str], str]:
    """What pip is to be told, and what a person is.

    Args:
        environment: Variables; PIP_EXTRA_INDEX_URL stays, and `index` comes to it where that serves.
        index: Of the CPU builds.

    Returns:
        Variables for pip, and one line about torch.
    """
    if has_gpu():
        return dict(environment), "torch with CUDA's libraries (some GB), for the GPU here"
    if not answers(index):
        return dict(
            environment
        ), f"torch as pip finds it (on PyPI with CUDA's libraries, some GB): no answer of {index}"
    given = environment.get("PIP_EXTRA_INDEX_URL", "").split()
    indices = given if index in given else [*given, index]
    return {**environment, "PIP_EXTRA_INDEX_URL": " ".join(indices)}, f"torch for CPUs (200 MB) from {index}"


def main() -> int:
    """Installs, and returns pip's exit code."""
    extras = ",".join(sys.argv[1:] or ["dev"])
    environment, torch = plan(os.environ)
    print(f"dohyo: downloading {WHAT}; {torch}", flush=True)
    return subprocess.run([sys.executable, *COMMAND, "-e", f".[{extras}]"], env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
