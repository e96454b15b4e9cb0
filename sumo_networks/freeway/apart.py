"""Simulations in a process of their own, so that SUMO's remaining state ends with that process.

After a simulation of queues (meso), SUMO rejects bicycles for the rest of the process.
"""

from __future__ import annotations

import multiprocessing
import signal
import socket
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import TypeVar

from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.processes import worker_process

Result = TypeVar("Result")
Progress = Callable[[float], None]


def drive_apart(drive: Callable[[Progress], Result], progress: Progress) -> Result:
    """Calls a function in a fresh process; where this process may open no sockets, in a new interpreter.

    Args:
        drive: Function to call with a function that receives its progress; it and its result can be pickled.
        progress: Function that receives the progress in this process.

    Returns:
        Result of the function.

    Raises:
        SimulationError: The process ended without an answer.
        Exception: The function raised this error.
    """
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = _process(theirs, drive)
    process.start()
    theirs.close()
    try:
        while isinstance(said := ours.recv(), float):
            progress(said)
    except EOFError:
        process.join()
        raise SimulationError(f"SUMO's own process ended with exit code {process.exitcode}") from None
    finally:
        ours.close()  # a process that may not be killed ends when it next tells its progress
        with suppress(PermissionError):  # as in an episode process of a service
            process.kill()
        process.join()
    result, error = said
    if error is not None:
        raise error
    return result  # type: ignore[no-any-return]


def _process(theirs: Connection, drive: Callable[[Progress], Result]) -> BaseProcess:
    """A process that sends the progress and result of a function, not started yet."""
    try:
        socket.socket(socket.AF_UNIX).close()
    except PermissionError:  # the server of worker processes needs one, a new interpreter none
        return multiprocessing.get_context("spawn").Process(target=_answer, args=(theirs, drive), daemon=True)
    return worker_process(_answer, theirs, drive)


def _answer(connection: Connection, drive: Callable[[Progress], Result]) -> None:
    """Sends each progress as a float, and at the end (result, error)."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the waiting parent is interrupted, and ends this process
    try:
        connection.send((drive(lambda share: connection.send(float(share))), None))
    except BrokenPipeError:
        pass  # the parent has gone
    except Exception as error:
        connection.send((None, error))
