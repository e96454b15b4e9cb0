"""Environment variables that processes of the service get: allow-lists, since any other may hold a secret."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

LANGUAGE: Final = ("LANG", "LC_ALL", "LC_CTYPE", "TZ")
LIBRARIES: Final = ("LD_LIBRARY_PATH", "NUMBA_CACHE_DIR", "NUMBA_CPU_NAME")
OF_TASKS: Final = (*LANGUAGE, *LIBRARIES)
OF_LIBRARIES: Final = (*OF_TASKS, "PATH", "XDG_CACHE_HOME")
OF_EPISODES: Final = (
    *OF_TASKS,
    *("PATH", "HOME", "TMPDIR", "VIRTUAL_ENV", "PYTHONPATH", "PYTHONHOME", "PYTHONDONTWRITEBYTECODE", "PYTHONWARNINGS"),
    *("XDG_CACHE_HOME", "XDG_DATA_HOME", "DOHYO_HOME", "DOHYO_CACHE", "DOHYO_POLICIES", "SUMO_HOME"),
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "CUDA_VISIBLE_DEVICES", "ORT_DISABLE_TELEMETRY"),
)


def of_task(folder: Path) -> dict[str, str]:
    """Variables of a confined task whose private folder this is."""
    from dohyo.sumo_networks.networks.network import cache_folder  # SUMO's readers take half a second to import

    return {
        **_given(OF_TASKS),
        "PATH": "/usr/bin:/bin",
        "HOME": str(folder),
        "TMPDIR": str(folder),
        "DOHYO_HOME": str(folder / "home"),
        "DOHYO_CACHE": str(cache_folder()),
        "XDG_CACHE_HOME": os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache"),
        "MPLCONFIGDIR": str(folder),
        "MUJOCO_GL": "disable",  # torchrl imports it where it is there, and it would start a process to find a window
    }


def of_episodes() -> dict[str, str]:
    """Variables of a process that drives episodes."""
    return _given(OF_EPISODES)


def without_secrets() -> dict[str, str]:
    """All variables but the service's own, for processes that need what their administrator set."""
    return {name: value for name, value in os.environ.items() if not name.startswith("DOHYO_") or name in OF_EPISODES}


def _given(names: tuple[str, ...]) -> dict[str, str]:
    return {name: os.environ[name] for name in names if name in os.environ}
