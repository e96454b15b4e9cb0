"""Worker processes that may start SUMO, which is global to its process and does not survive a fork once it runs.

They are forked from a server that has loaded the libraries and started nothing. A process starts within 20 ms, where a
new interpreter needs two seconds of processor time.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.context import ForkServerContext, SpawnContext
from multiprocessing.process import ORIGINAL_DIR, BaseProcess  # type: ignore[attr-defined]
from pathlib import Path
from typing import Any, Final

from dohyo.sumo_networks.errors import InvalidInputError

PRELOADED = "dohyo.sumo_networks.preloaded"

UNGUARDED: Final = 78
"""Exit code of a worker process that imported a script without a guard, and was asked by it to start work again."""
GUARD: Final = 'a script that starts processes needs `if __name__ == "__main__":` around what it does'

CGROUPS: Final = Path("/sys/fs/cgroup")
OWN_CGROUP: Final = Path("/proc/self/cgroup")

_owner: int | None = None
"""Process that started the server, and that alone can use it: not one that was forked from it."""


def usable_processors() -> int:
    """Number of processors that this process may use, at least 1: by its affinity, and by the quota of its container.

    A quota of cgroups v2 counts, rounded up: 1.5 processors are two.
    """
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quota = _quota()
    return there if math.isinf(quota) else max(1, min(there, math.ceil(quota)))


def _quota() -> float:
    """Processors that the control group of this process and those above it may use; `inf` where nothing limits them."""
    try:
        lines = OWN_CGROUP.read_text().splitlines()
    except OSError:
        return math.inf
    own = next((line.removeprefix("0::/") for line in lines if line.startswith("0::/")), None)
    if own is None:  # cgroups v1 alone
        return math.inf
    groups = [CGROUPS / own, *(CGROUPS / above for above in Path(own).parents)]
    return min(_quota_of(group / "cpu.max") for group in groups)


def _quota_of(file: Path) -> float:
    try:
        quota, period = file.read_text().split()
        return math.inf if quota == "max" else int(quota) / int(period)
    except (OSError, ValueError, ZeroDivisionError):  # the topmost group has no such file
        return math.inf


def worker_context() -> ForkServerContext | SpawnContext:
    """Context of worker processes, for pipes and shared memory; new interpreters where there can be no server."""
    global _owner
    if _owner not in (None, os.getpid()):
        return multiprocessing.get_context("spawn")
    _owner = os.getpid()
    return multiprocessing.get_context("forkserver")


def end_unguarded() -> None:
    """Ends this process if it is a worker that still imports the script of its parent, which begins work again."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):  # as multiprocessing itself finds out
        os._exit(UNGUARDED)


def worker_process(target: Callable[..., object], *arguments: object) -> BaseProcess:
    """Makes a worker process, not started yet; it ends with its parent.

    Args:
        target: Function to call in the process. The server loads the module of the first target.
        arguments: Arguments of the function.

    Returns:
        The process, with the environment variables that this process has now. It ends with `UNGUARDED` where the script
        of this process starts others as it is imported.

    Raises:
        InvalidInputError: The script of this process is no file, such as standard input, and cannot be imported again.
    """
    context = _preloading(target)
    return context.Process(target=_call, args=(dict(os.environ), target, *arguments), daemon=True)


def worker_pool(
    workers: int, target: Callable[..., object], *, max_tasks_per_child: int | None = None
) -> ProcessPoolExecutor:
    """Makes a pool of worker processes with the environment variables that this process has now.

    Args:
        workers: Number of processes.
        target: Function that the pool will call. The server loads the module of the first target.
        max_tasks_per_child: Calls after which a process is replaced.

    Raises:
        InvalidInputError: See `worker_process`.
    """
    return ProcessPoolExecutor(
        workers,
        mp_context=_preloading(target),
        initializer=_adopt,
        initargs=(dict(os.environ),),
        max_tasks_per_child=max_tasks_per_child,
    )


def _preloading(target: Callable[..., object]) -> ForkServerContext | SpawnContext:
    end_unguarded()
    script = getattr(sys.modules["__main__"], "__file__", None)
    if script is not None and not Path(ORIGINAL_DIR, script).exists():
        raise InvalidInputError(f"expected a script in a file, which processes can import, got '{script}'")
    context = worker_context()
    context.set_forkserver_preload([PRELOADED, target.__module__])  # without effect once the server runs
    return context


def _call(environment: Mapping[str, str], target: Callable[..., object], *arguments: Any) -> None:
    _adopt(environment)
    target(*arguments)


def _adopt(environment: Mapping[str, str]) -> None:
    """Takes over environment variables: a forked process has those of the server, from when that was started."""
    os.environ.clear()
    os.environ.update(environment)
