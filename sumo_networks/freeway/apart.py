"""A simulation in a process of its own: what SUMO keeps of it ends with that process.

After queues (meso) SUMO refuses bicycles for the rest of its process. The processes are forked from a server that has
loaded SUMO and started nothing, which costs some 20 ms each.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import TypeVar

from dohyo.sumo_networks.errors import SimulationError

Result = TypeVar("Result")
Progress = Callable[[float], None]


def drive_apart(drive: Callable[[Progress], Result], progress: Progress) -> Result:
    """Calls a function in a fresh process.

    Args:
        drive: What to call, with the function that takes its progress; it and its result can be pickled.
        progress: Told the same, here.

    Returns:
        What the function returned.

    Raises:
        SimulationError: The process ended without an answer.
        Exception: Whatever the function raised.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["dohyo.sumo_networks.freeway.days"])
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(theirs, drive))
    process.start()
    theirs.close()
    try:
        while isinstance(said := ours.recv(), float):
            progress(said)
    except EOFError:
        process.join()
        raise SimulationError(f"SUMO's own process ended with exit code {process.exitcode}") from None
    finally:
        process.kill()
        process.join()
        ours.close()
    result, error = said
    if error is not None:
        raise error
    return result  # type: ignore[no-any-return]


def _answer(connection: Connection, drive: Callable[[Progress], Result]) -> None:
    """Sends each progress, a float, and at last (result, error)."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the waiting parent is interrupted, and ends this process
    try:
        connection.send((drive(lambda share: connection.send(float(share))), None))
    except BrokenPipeError:
        pass  # the parent has gone
    except Exception as error:
        connection.send((None, error))
