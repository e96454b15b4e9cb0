"""Runner: runs a task on what strangers sent, in a new confined process, within limits.

`run` blocks, so call it from a thread; `run_async` is for the event loop. Each ends with the answer, or with one error
that says why there is none, and leaves no process and no temporary folder.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from threading import BoundedSemaphore, Event
from typing import Any, Final

from dohyo.service.confinement.environment import of_task
from dohyo.service.confinement.errors import TaskBrokenError, TaskDiskFullError, TaskError
from dohyo.service.confinement.folders import private_folder, size_of
from dohyo.service.confinement.limits import MEGABYTE, Limits
from dohyo.service.confinement.process import ConfinedProcess, Watch
from dohyo.service.confinement.tasks import TASKS
from dohyo.service.errors import BusyError, StorageFullError
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.network import cache_folder

WAIT_S: Final = 20.0
_PAGE: Final = os.sysconf("SC_PAGE_SIZE")

logger = logging.getLogger("dohyo.confinement")

_slots = {name: BoundedSemaphore(task.at_once) for name, task in TASKS.items()}
_threads = ThreadPoolExecutor(32, "confined")


def run(
    task: str,
    arguments: Mapping[str, Any],
    limits: Limits,
    *,
    folder: Path | None = None,
    reads: Iterable[Path] = (),
    imports: Iterable[str] = (),
    environment: Mapping[str, str] | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Any:
    """Runs a task in a new confined process.

    Args:
        task: A name in `TASKS`.
        arguments: Plain JSON, which may come from strangers.
        limits: Limits of the task.
        folder: Its private folder, where the caller wants to keep what the task writes; None: a temporary one.
        reads: Files and folders that it may read besides the installation.
        imports: Modules of the service to import before the confinement.
        environment: More environment variables.
        stopped: Asked now and then; once true, the task is ended.

    Returns:
        The task's answer.

    Raises:
        InvalidInputError: The task refused its input, passed a limit, or broke.
        BusyError: Too many tasks of this name are running.
        StorageFullError: The disk is full.
        ConfinementError: This machine cannot confine a process.
    """
    if not _slots[task].acquire(timeout=WAIT_S):
        raise BusyError(f"too many tasks '{task}' are running", retry_s=WAIT_S)
    began = time.monotonic()
    try:
        with ExitStack() as stack:
            own = folder or stack.enter_context(private_folder())
            variables = of_task(own) | dict(environment or {})
            known = [*reads, *_caches(variables)]
            process = ConfinedProcess(task, limits, folder=own, reads=known, imports=imports, environment=variables)
            stack.callback(process.end)
            process.send(json.dumps(arguments).encode(), limits.wall_s, "reading its input")
            return json.loads(process.receive(limits.wall_s, "the task", _watch(process.pid, own, limits, stopped)))
    except TaskDiskFullError as error:
        raise StorageFullError() from error
    except (TaskError, ValueError) as error:
        seconds = time.monotonic() - began
        logger.warning("task '%s' gave no answer after %.1f s: %s", task, seconds, getattr(error, "trace", "") or error)
        raise InvalidInputError(_reason(error)) from error
    finally:
        _slots[task].release()


async def run_async(task: str, arguments: Mapping[str, Any], limits: Limits, **options: Any) -> Any:
    """The same for the event loop; a cancellation ends the task."""
    stop = Event()
    call = partial(run, task, arguments, limits, stopped=stop.is_set, **options)
    try:
        return await asyncio.get_running_loop().run_in_executor(_threads, call)
    finally:
        stop.set()


def _reason(error: Exception) -> str:
    if isinstance(error, TaskBrokenError):
        return f"it could not be checked: {error}"
    return str(error) if isinstance(error, TaskError) else "its process answered nonsense"


def _caches(environment: Mapping[str, str]) -> list[Path]:
    """Folders of parsed networks and of compiled kernels, which any task may read."""
    kernels = environment.get("NUMBA_CACHE_DIR") or f"{environment['XDG_CACHE_HOME']}/numba"
    return [cache_folder() / "networks", Path(kernels)]


def _watch(group: int, folder: Path, limits: Limits, stopped: Callable[[], bool]) -> Watch:
    def look() -> str | None:
        if stopped():
            return "it was cancelled"
        processes, memory = _use(group)
        if processes > limits.processes:
            return f"it started {processes} processes, at most {limits.processes} are allowed"
        if memory > limits.memory_mb * MEGABYTE:
            return f"it needs more than the {limits.memory_mb} MB of memory it may have"
        if size_of(folder) > limits.folder_mb * MEGABYTE:
            return f"it writes more than the {limits.folder_mb} MB of files it may have"
        return None

    return look


def _use(group: int) -> tuple[int, int]:
    """Number of processes of a process group, and their memory in use, bytes."""
    processes = memory = 0
    for entry in os.scandir("/proc"):
        if not entry.name.isdecimal():
            continue
        try:
            with open(f"/proc/{entry.name}/stat", "rb") as file:
                fields = file.read().rpartition(b")")[2].split()
        except OSError:  # it has ended meanwhile
            continue
        if int(fields[2]) == group and fields[0] != b"Z":  # one that has ended stays until its parent asks for its code
            processes += 1
            memory += int(fields[21]) * _PAGE
    return processes, memory
