"""WorkerProcess: a process that calls agents, whose parent sees a call that is overdue and can replace the process.

A worker whose parent has died ends itself.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from multiprocessing.sharedctypes import Synchronized
from typing import Any

from dohyo.sumo_networks.processes import worker_context, worker_process


@dataclass(frozen=True, slots=True)
class Parent:
    """A worker process's link to its parent.

    Attributes:
        pipe: Jobs come in, answers go out.
        must_end_by: Moment on the monotonic clock by which the agent must have returned, s; 0 while none is called.
        called: Number of the ego whose agent was called last.
    """

    pipe: Connection
    must_end_by: Synchronized[float]
    called: Synchronized[int]

    def jobs(self) -> Iterator[Any]:
        """Yields one job after the other; the process ends when its parent closes the pipe or dies."""
        jobs, arrived = deque[Any](), threading.Semaphore(0)

        def listen() -> None:
            while True:
                try:
                    jobs.append(self.pipe.recv())
                except (EOFError, OSError):
                    os._exit(0)
                arrived.release()

        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends its workers
        threading.Thread(target=listen, daemon=True).start()
        while True:
            arrived.acquire()
            yield jobs.popleft()

    def watch(self, seconds: float, ego: int = 0) -> None:
        """The agent of an ego is called and may take so long; 0: it has returned."""
        self.called.value = ego
        self.must_end_by.value = time.monotonic() + seconds if seconds else 0.0

    def send(self, answer: object) -> None:
        """Sends an answer, once the parent has room for it."""
        self.pipe.send(answer)


class WorkerProcess:
    """The parent's handle of a worker process.

    Attributes:
        pipe: Jobs go out, answers come in.
    """

    pipe: Connection
    _process: BaseProcess
    _link: Parent
    _closed: bool

    def __init__(self, target: Callable[[Parent], None]) -> None:
        """Starts a process.

        Args:
            target: Function to call in it, which works on `Parent.jobs`.
        """
        self._target = target
        self._start()

    def _start(self) -> None:
        context = worker_context()
        self.pipe, theirs = context.Pipe()
        self._link = Parent(theirs, context.Value("d", 0.0), context.Value("i", 0))
        self._process, self._closed = worker_process(self._target, self._link), False
        self._process.start()
        theirs.close()

    @property
    def in_call(self) -> bool:
        """Whether an agent is called, or was when the process died."""
        return self._link.must_end_by.value > 0

    @property
    def called(self) -> int:
        """Number of the ego whose agent was called last."""
        return self._link.called.value

    @property
    def exit_code(self) -> int | None:
        """Exit code of a process that has died."""
        self._process.join(timeout=1.0)
        return self._process.exitcode

    def is_overdue(self, grace_s: float) -> bool:
        """Whether a call of an agent is so far past its deadline that the process must be ended."""
        must_end_by = self._link.must_end_by.value
        return must_end_by > 0 and time.monotonic() > must_end_by + grace_s

    def is_dead(self) -> bool:
        """Whether the process has ended, or closed its end of the pipe."""
        return self._closed or not self._process.is_alive()

    def send(self, job: object) -> None:
        """Sends a job; replaces a process that died between jobs."""
        try:
            self.pipe.send(job)
        except OSError:
            self.replace()
            self.pipe.send(job)

    def answer(self) -> Any:
        """The next answer that has arrived; None if there is none."""
        try:
            return self.pipe.recv() if self.pipe.poll() else None
        except (EOFError, OSError):
            self._closed = True
            return None

    def replace(self) -> None:
        """Ends the process and starts another one."""
        self.stop()
        self._start()

    def stop(self, patience_s: float = 1.0) -> None:
        """Ends the process, an idle one by closing its pipe; kills it if it still runs after a time, s."""
        self.pipe.close()
        self._process.join(timeout=patience_s)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
