"""Simulations in a process of their own, so that SUMO's remaining state ends with that process.

After a simulation of queues (meso), SUMO rejects bicycles for the rest of the process.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import TypeVar

from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.processes import worker_context, worker_process

Result = TypeVar("Result")
Progress = Callable[[float], None]


def drive_apart(drive: Callable[[Progress], Result], progress: Progress) -> Result:
    """Calls a function in a fresh process.

    Args:
        drive: Function to call with a function that receives its progress; it and its result can be pickled.
        progress: Function that receives the progress in this process.

    Returns:
        Result of the function.

    Raises:
        SimulationError: The process ended without an answer.
        Exception: The function raised this error.
    """
    ours, theirs = worker_context().Pipe(duplex=False)
    process = worker_process(_answer, theirs, drive)
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
    """Sends each progress as a float, and at the end (result, error)."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the waiting parent is interrupted, and ends this process
    try:
        connection.send((drive(lambda share: connection.send(float(share))), None))
    except BrokenPipeError:
        pass  # the parent has gone
    except Exception as error:
        connection.send((None, error))
