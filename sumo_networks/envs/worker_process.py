"""WorkerProcess: a process that carries out commands, and ends with its parent, `JOIN_S` later at most.

Only a call of C that holds Python's lock for longer delays that.

A step is one byte to the worker and one back: nothing is pickled.
"""

from __future__ import annotations

import os
import pickle
import select
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, Protocol

from dohyo.sumo_networks.errors import DohyoError, InvalidInputError, SimulationError
from dohyo.sumo_networks.processes import GUARD, UNGUARDED, worker_context, worker_process

JOIN_S = 5.0
# After a sleep between two ticks of 0.2 ms, the core is halted and its caches are cold, and a tick takes 50 % longer.
# So both sides poll for the next message for a time before they sleep, and yield the core between polls.
SPIN_S = 0.0005
# The processes of a run fill the cores already; a second thread in each slows all of them down.
ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
STEP = "step"
"""The command that is sent as an empty message."""
_EMPTY, _FULL = b".", b"+"


class WorkerDeathError(SimulationError):
    """The process has ended by itself, or was killed."""


class Host(Protocol):
    """What a worker holds."""

    def carry_out(self, command: str, *arguments: Any) -> Any:
        """Carries out a command."""

    def close(self) -> None:
        """Called before the process ends."""


class Pipe:
    """One end of a pipe between parent and worker."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._poll = select.poll()
        self._poll.register(connection.fileno(), select.POLLIN)
        self.close = connection.close

    def send(self, message: bytes) -> None:
        """Sends a message; an empty one takes a third of the time. Raises OSError if the other end is closed."""
        os.write(self._connection.fileno(), _FULL if message else _EMPTY)
        if message:
            self._connection.send_bytes(message)

    def receive(self) -> bytes:
        """Receives the next message; raises EOFError or OSError if the other end is closed."""
        patience = time.perf_counter() + SPIN_S
        while not self._poll.poll(0) and time.perf_counter() < patience:
            os.sched_yield()
        kind = os.read(self._connection.fileno(), 1)
        if not kind:
            raise EOFError
        return b"" if kind == _EMPTY else self._connection.recv_bytes()


class WorkerProcess:
    """One process with a host. Takes one command at a time: `receive` must follow every `send`."""

    def __init__(self, number: int, make_host: Callable[[], Host]) -> None:
        """Starts the process.

        Args:
            number: Named in errors.
            make_host: Makes what carries out the commands, in the new process.

        Raises:
            InvalidInputError: The host cannot be sent to another process.
        """
        self._number, self._make_host = number, make_host
        self._process: BaseProcess | None = None
        self.start()

    @property
    def pid(self) -> int | None:
        """Number of the process, if there is one."""
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        """Starts the process unless there is one."""
        if self._process is not None:
            return
        ours, theirs = worker_context().Pipe()
        try:
            with _one_thread():
                process = worker_process(_serve, _Watched(theirs), self._make_host)
                process.start()
        except (AttributeError, TypeError, pickle.PicklingError) as error:  # what pickle raises
            ours.close()
            raise InvalidInputError(f"worker {self._number} cannot be sent to another process: {error}") from error
        finally:
            theirs.close()
        self._process, self._pipe = process, Pipe(ours)

    def send(self, command: str, *arguments: Any) -> None:
        """Begins a command of the host; the death of the process shows in `receive`."""
        self.start()
        message = b"" if command == STEP else pickle.dumps((command, arguments))
        with suppress(OSError):  # `receive` meets the same end
            self._pipe.send(message)

    def receive(self) -> Any:
        """Waits for the end of the command.

        Raises:
            WorkerDeathError: The process has died.
            Exception: What the command raised, with the worker's traceback as a note.
        """
        try:
            message = self._pipe.receive()
        except (EOFError, OSError) as error:
            raise self._death() from error
        if not message:
            return None
        answer = pickle.loads(message)
        if isinstance(answer, _Raised):
            raise answer.unpacked(self._number)
        return answer

    def begin_stop(self) -> None:
        """Tells the process to end."""
        if self._process is not None:
            self._pipe.close()

    def stop(self) -> None:
        """Ends the process; the next command starts a new one."""
        if self._process is None:
            return
        self._pipe.close()
        self._process.join(JOIN_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()
        self._process = None

    def _death(self) -> WorkerDeathError:
        assert self._process is not None  # it was sent a command
        self._process.join(JOIN_S)
        process = self._process
        if process.exitcode == UNGUARDED:
            return WorkerDeathError(f"worker {self._number} ran the script again: {GUARD}")
        return WorkerDeathError(f"worker {self._number} (process {process.pid}) ended with code {process.exitcode}")


class _Raised:
    """An error on its way to the parent: class and arguments, whose pickling is certain, and the traceback."""

    def __init__(self, error: Exception) -> None:
        self.kind: type[Exception] = type(error)
        self.args, self.trace = error.args, "".join(traceback.format_exception(error))
        try:
            pickle.dumps((self.kind, self.args))
        except Exception:
            self.kind, self.args = DohyoError, (f"{type(error).__name__}: {error}",)

    def unpacked(self, worker: int) -> Exception:
        """The error, with the worker's traceback as a note."""
        error = self.kind.__new__(self.kind, *self.args)  # its constructor may want other arguments
        error.args = self.args
        error.add_note(f"in worker {worker}:\n{self.trace}")
        return error


@contextmanager
def _one_thread() -> Iterator[None]:
    """Makes child processes compute with one thread."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


class _Watched:
    """The worker's end of the pipe, watched from its unpickling on: what follows it may be imported for long."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def __reduce__(self) -> tuple[Callable[[Connection], Connection], tuple[Connection]]:
        return _watch, (self._connection,)


def _watch(connection: Connection) -> Connection:
    """Ends this process `JOIN_S` after the other end is closed, unless `_serve` has done so; returns this end."""
    other_end = select.poll()
    other_end.register(connection.fileno(), 0)  # no message wakes it

    def wait() -> None:
        other_end.poll()
        time.sleep(JOIN_S)
        os._exit(1)

    threading.Thread(target=wait, name="watch", daemon=True).start()
    return connection


def _serve(connection: Connection, make_host: Callable[[], Host]) -> None:
    """Main function of a worker: carries out commands until its parent closes the pipe or ends."""
    # The parent handles Ctrl-C and signals to its group, then closes the pipe. A session of its own would do too, but
    # Linux may then schedule the worker as a group apart (autogroup), in which sched_yield yields to nobody.
    os.setpgrp()
    pipe, host = Pipe(connection), make_host()
    try:
        while True:
            message = pipe.receive()
            command, arguments = pickle.loads(message) if message else (STEP, ())
            try:
                answer = host.carry_out(command, *arguments)
            except Exception as error:
                answer = _Raised(error)
            pipe.send(b"" if answer is None else pickle.dumps(answer))
    except (EOFError, OSError):
        host.close()
