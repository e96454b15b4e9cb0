"""ConfinedProcess: the parent's handle of a process that runs one task and ends.

Requests and answers go over two pipes, in frames whose length is bounded. `rights` says what the process gives up; this
end bounds time, and ends the process group when it is over.
"""

from __future__ import annotations

import dataclasses
import fcntl
import json
import math
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from dohyo.service.confinement.environment import OF_LIBRARIES
from dohyo.service.confinement.errors import (
    ConfinementError,
    TaskBrokenError,
    TaskDiskFullError,
    TaskError,
    TaskTimeoutError,
)
from dohyo.service.confinement.frames import BAD, BROKEN, FULL, GOOD, LENGTH
from dohyo.service.confinement.limits import MEGABYTE, Limits
from dohyo.service.confinement.seccomp import is_filtered
from dohyo.service.confinement.tasks import TASKS, Rights
from dohyo.service.forking.process import ForkedProcess
from dohyo.service.forking.server import Launch, Template, fork

START_S: Final = 60.0
END_S: Final = 10.0
LOOK_S: Final = 0.2
PIPE_BYTES: Final = 1 << 20
START: Final = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from dohyo.service.confinement.child import main; main()"
)
# None of the service's environment but this. One thread in numpy's libraries; onnxruntime's wheels send telemetry
# unless disabled.
ENVIRONMENT: Final[Mapping[str, str]] = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "ORT_DISABLE_TELEMETRY": "1",
}

OPTIONS: Final = ("-I", "-B")
TEMPLATE: Final = Template("dohyo.service.confinement.child:prepare", OPTIONS, quiet=True)

Process = subprocess.Popen[bytes] | ForkedProcess
Started = tuple[Process, int, int]
"""A process, and this end of its requests and of its answers."""
Watch = Callable[[], str | None]
"""Looked at while an answer is awaited; a reason ends the process."""


class ConfinedProcess:
    """A process for one task.

    Attributes:
        pid: Identifier of the process, and of its group unless it only computes.
        layers: Layers of its confinement, see `rights.give_up`.
        end: Ends the process and its group; a second call has no effect.
    """

    def __init__(
        self,
        task: str,
        limits: Limits,
        *,
        folder: Path | None = None,
        reads: Iterable[Path] = (),
        imports: Iterable[str] = (),
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Starts the process and waits until it is confined.

        Args:
            task: A name in `TASKS`.
            limits: Limits of the process.
            folder: Private folder, its working directory; needed unless the task only computes.
            reads: Files and folders that it may read besides the installation.
            imports: Modules of the service to import before the confinement.
            environment: Variables besides `ENVIRONMENT`.

        Raises:
            ConfinementError: The process cannot be started, or not be confined.
        """
        self._limits = limits
        own_group = TASKS[task].rights is not Rights.COMPUTE  # a process that only computes can start no other
        variables = {**ENVIRONMENT, **(environment or {})}
        # A process that only computes holds nothing but its own libraries; a confined one has no fork server.
        start = _start_copy if own_group and not is_filtered() else _start_interpreter
        try:
            process, self._in, self._out = start(variables, folder or Path("/"), own_group)
        except OSError as error:
            raise ConfinementError(f"a confined process cannot be started: {error}") from error
        self.pid, self._process = process.pid, process
        # Runs without a call of `end` and at exit too, so that no process is left behind.
        self.end = weakref.finalize(self, _end, process, (self._in, self._out), own_group)
        os.set_blocking(self._in, False)
        os.set_blocking(self._out, False)
        self._writable, self._readable = select.poll(), select.poll()
        self._writable.register(self._in, select.POLLOUT)
        self._readable.register(self._out, select.POLLIN)
        launch = {
            "task": task,
            "limits": dataclasses.asdict(limits),
            "folder": str(folder or tempfile.gettempdir()),
            "reads": [str(path) for path in reads],
            "imports": list(imports),
        }
        try:
            _widen(self._in)
            self.send(json.dumps(launch).encode(), START_S, "starting")
            self.layers: dict[str, Any] = json.loads(self.receive(START_S, "starting"))
            if not is_filtered():  # inside another confined process, that one's end is the end of this one
                process.send_signal(0)
        except PermissionError as error:
            self.end()
            raise ConfinementError("this machine does not let the service end a confined process") from error
        except (TaskError, ValueError) as error:
            self.end()
            raise ConfinementError(f"this machine cannot confine a process: {error}") from error
        except BaseException:
            self.end()
            raise

    def send(self, content: bytes, seconds: float, what: str) -> None:
        """Sends a frame; see `send_raw`."""
        self.send_raw(LENGTH.pack(len(content)) + content, seconds, what)

    def send_raw(self, content: bytes, seconds: float, what: str) -> None:
        """Sends bytes of a length that the process knows.

        Args:
            content: Bytes to send.
            seconds: Time that the process has to read them.
            what: Name of the step, for messages.

        Raises:
            TaskError: The process has ended.
            TaskTimeoutError: The process does not read in time and was ended.
        """
        if not self.end.alive:
            raise TaskError("its process has ended")
        until, view = time.monotonic() + seconds, memoryview(content)
        while view:
            try:
                view = view[os.write(self._in, view) :]
            except BlockingIOError:
                self._wait(self._writable, until, seconds, what)
            except BrokenPipeError:
                # The process may have sent its reason before it ended.
                self.receive(seconds, what)
                raise self._died(what) from None

    def receive(self, seconds: float, what: str, watch: Watch | None = None) -> bytes:
        """The content of the next answer.

        Args:
            seconds: Time that the process has to answer.
            what: Name of the step, for messages.
            watch: Looked at now and then.

        Raises:
            TaskError: The task failed or its process has ended.
            TaskTimeoutError: There is none in time; the process was ended.
        """
        until, got, size = time.monotonic() + seconds, b"", LENGTH.size
        while len(got) < size:
            self._wait(self._readable, until, seconds, what, watch)
            part = os.read(self._out, size - len(got))
            if not part:
                raise self._died(what)
            got += part
            if len(got) == LENGTH.size:
                size += LENGTH.unpack(got)[0]
                if not LENGTH.size < size <= LENGTH.size + self._limits.answer_mb * MEGABYTE:
                    self.end()
                    raise TaskError("its process answered nonsense")
        return _good(got[LENGTH.size : LENGTH.size + 1], got[LENGTH.size + 1 :])

    def _wait(self, poll: select.poll, until: float, seconds: float, what: str, watch: Watch | None = None) -> None:
        while True:
            left = until - time.monotonic()
            if left <= 0:
                self.end()
                raise TaskTimeoutError(f"its process was ended: {what} took longer than {seconds:g} s")
            if poll.poll(math.ceil((left if watch is None else min(left, LOOK_S)) * 1000)):
                return
            if watch is not None and (reason := watch()) is not None:
                self.end()
                raise TaskError(f"its process was ended: {reason}")

    def _died(self, what: str) -> TaskError:
        """Reason of a missing answer; ends the process if it still runs."""
        code = _exit_code(self._process)
        self.end()
        limits = self._limits
        reasons = {
            -signal.SIGXCPU: f"it used more than {limits.cpu_s} s of processor time",
            -signal.SIGALRM: f"{what} took too long",
        }
        crash = f"code {code}" if code >= 0 else signal.Signals(-code).name
        memory = f"it crashed ({crash}), as it does when it needs more than {limits.memory_mb} MB"
        return TaskError(f"its process ended: {reasons.get(code, memory)} ({what})")


def _good(kind: bytes, content: bytes) -> bytes:
    """The content of an answer.

    Raises:
        TaskError: It is none, but a reason.
    """
    if kind == GOOD:
        return content
    text = content.decode(errors="replace")
    if kind == FULL:
        raise TaskDiskFullError("no space is left on the disk")
    if kind == BROKEN:
        lines = text.strip().splitlines()
        raise TaskBrokenError(lines[-1][:200] if lines else "unknown", text)
    raise TaskError(text if kind == BAD else "its process answered nonsense")


def _start_interpreter(environment: Mapping[str, str], folder: Path, own_group: bool) -> Started:
    """A new interpreter with nothing loaded."""
    requests, answers = os.pipe(), os.pipe()
    try:
        process = subprocess.Popen(
            [sys.executable, *OPTIONS, "-c", START, json.dumps(_search_path())],
            stdin=requests[0],
            stdout=answers[1],
            stderr=subprocess.DEVNULL,
            env=environment,
            cwd=folder,
            start_new_session=own_group,
        )
    except BaseException:
        _close(requests[1], answers[0])
        raise
    finally:
        _close(requests[0], answers[1])
    return process, requests[1], answers[0]


def _start_copy(environment: Mapping[str, str], folder: Path, _: bool) -> Started:
    """A copy of the fork server of tasks, which has the variables that libraries read."""
    requests, answers = os.pipe(), os.pipe()
    common = {name: environment[name] for name in (*ENVIRONMENT, *OF_LIBRARIES) if name in environment}
    launch = Launch("dohyo.service.confinement.child:run_task", "dohyo-task", environment, folder, _search_path())
    try:
        process = fork(TEMPLATE, common, launch, (requests[0], answers[1]))
    except BaseException:
        _close(requests[1], answers[0])
        raise
    finally:
        _close(requests[0], answers[1])
    return process, requests[1], answers[0]


def _search_path() -> list[str]:
    return [entry for entry in sys.path if entry]


def _close(*files: int) -> None:
    for file in files:
        os.close(file)


def _exit_code(process: Process, patience_s: float = 1.0) -> int:
    """Exit code of a process, whose group keeps its number; 0: it still runs."""
    if isinstance(process, ForkedProcess):
        try:
            return process.wait(patience_s)
        except subprocess.TimeoutExpired:
            return 0
    return _exit_code_of_child(process.pid, patience_s)


def _exit_code_of_child(pid: int, patience_s: float) -> int:
    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        ended = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT | os.WNOHANG)
        if ended is not None:
            return ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status
        time.sleep(0.005)
    return 0


def _end(process: Process, pipes: tuple[int, int], own_group: bool) -> None:
    _close(*pipes)
    with suppress(PermissionError, ProcessLookupError):  # the process ends itself, since its pipe is closed
        if own_group:
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    with suppress(subprocess.TimeoutExpired):  # in a confined process, whose own end ends this one too
        process.wait(END_S)
    if isinstance(process, ForkedProcess):
        process.release()


def _widen(pipe: int) -> None:
    """Enlarges the pipe, so that a camera image passes in one piece where the system allows it."""
    try:
        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
    except OSError:
        return
