"""The confined process: imports a task, gives up its rights, then reads the task's input and runs it once.

The launch, the first request, is the parent's own: nothing of it comes from strangers. See `process` for the other end.
"""

from __future__ import annotations

import errno
import json
import os
import signal
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from dohyo.service.confinement.frames import BAD, BROKEN, FULL, GOOD, Stream
from dohyo.service.confinement.limits import Limits
from dohyo.service.confinement.rights import give_up, leave_network, limit_processor_time
from dohyo.service.confinement.seccomp import install_filter
from dohyo.service.confinement.tasks import TASKS, ConfinedTask, Rights
from dohyo.sumo_networks.errors import DohyoError

NO_SPACE = frozenset((errno.ENOSPC, errno.EDQUOT))


LIBRARIES: Final = (
    "dohyo.service.episodes.redrive",
    "dohyo.service.networks.importing",
    "dohyo.sumo_networks.preloaded",
)


def prepare() -> None:
    """Loads what tasks with files need, in a fork server."""
    _read_compiled_kernels()
    for module in LIBRARIES:
        import_module(module)


def main() -> None:
    """Runs the one task that arrives on standard input, in a new interpreter."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends with its parent, or by SIGKILL
    # Output of libraries must not mix with the answers.
    answers = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    run_task(0, answers)


def run_task(requests: int, answers: int) -> None:
    """Runs one task.

    Args:
        requests: Descriptor that the task arrives on.
        answers: Descriptor for the answers.
    """
    stream = Stream(requests, answers)
    launch = json.loads(stream.read())
    task = TASKS[launch["task"]]
    try:
        function, layers = _prepare(task, launch)
    except Exception as error:  # reported to the parent, which then runs nothing
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        stream.write(BAD, f"{type(error).__name__}: {lines[0] if lines else 'no reason'}")
        return
    stream.write(GOOD, json.dumps(layers))
    _run(task, function, stream, requests)
    os._exit(0)  # SUMO does not survive the interpreter's own end


def _prepare(task: ConfinedTask, launch: dict[str, Any]) -> tuple[Callable[..., Any], dict[str, Any]]:
    """Imports what the task needs and confines the process; returns the task's function and the layers."""
    own_network = leave_network()  # first, while the process has one thread
    limits, folder = Limits(**launch["limits"]), Path(launch["folder"])
    reads = [Path(path) for path in launch["reads"]]
    if task.rights is Rights.COMPUTE:  # it can import nothing afterwards
        function = _imported(task, launch["imports"])
        layers = give_up(task.rights, limits, folder, reads)
    else:  # libraries start threads when they are imported, and Landlock is for each thread alone
        layers = give_up(task.rights, limits, folder, reads)
        _read_compiled_kernels()
        function = _imported(task, launch["imports"])
    limit_processor_time(limits.cpu_s)
    install_filter(task.rights)
    return function, {**layers, "own_network": own_network, "system_calls_filtered": True}


def _imported(task: ConfinedTask, others: list[str]) -> Callable[..., Any]:
    module, _, name = task.function.partition(":")
    function: Callable[..., Any] = getattr(import_module(module), name)
    for other in others:
        import_module(other)
    return function


def _run(task: ConfinedTask, function: Callable[..., Any], stream: Stream, requests: int) -> None:
    try:
        if task.streams:
            function(stream)
            return
        arguments = json.loads(stream.read())
        if task.rights is not Rights.COMPUTE:  # which has no threads, and no time without limits
            threading.Thread(target=_end_with_parent, args=(requests,), daemon=True).start()
        stream.write(GOOD, json.dumps(function(arguments)))
    except EOFError:
        return
    except MemoryError:
        stream.write(BAD, "it needs more memory than it may have")
    except Exception as error:  # hostile input may make libraries raise anything
        number = _number(error)
        if number in NO_SPACE:
            stream.write(FULL)
        elif number == errno.EFBIG:
            stream.write(BAD, "it writes a larger file than it may")
        elif task.streams or isinstance(error, DohyoError):
            stream.write(BAD, str(error) or type(error).__name__)
        else:
            stream.write(BROKEN, traceback.format_exc())


def _end_with_parent(requests: int) -> None:
    """Ends the whole process group, once the parent is gone."""
    while os.read(requests, 1):
        pass
    os.kill(0, signal.SIGKILL)


@cache
def _read_compiled_kernels() -> None:
    """Lets numba read kernels that were compiled before, and go on where it may not store others."""
    caching: Any = import_module("numba.core.caching")
    store = caching.Cache.save_overload

    def is_in_use(locator: Any) -> None:
        if not any(Path(locator.get_cache_path()).glob("*.nbi")):
            raise PermissionError(locator.get_cache_path())

    def save_overload(cache: Any, signature: Any, data: Any) -> None:
        with suppress(OSError):
            store(cache, signature, data)

    # By default numba uses the first folder that it may write to; here there is none.
    caching.InTreeCacheLocator.ensure_cache_path = is_in_use
    caching.UserProvidedCacheLocator.ensure_cache_path = lambda locator: None
    caching.UserWideCacheLocator.ensure_cache_path = lambda locator: None
    caching.Cache.save_overload = save_overload


def _number(error: BaseException) -> int | None:
    """Number of the operating system's error behind an error."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, OSError):
        cause = cause.__cause__
    return cause.errno if cause is not None else None
