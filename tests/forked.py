"""Python processes that start at once: forked from a server that has loaded the libraries and started nothing.

    python = Python("import torch; print(torch.get_num_threads())")
    assert (python.end(), python.output()) == (0, "1\n")

A new interpreter needs four to six seconds of processor time for torch, torchrl and SUMO. What is forked is a process
of its own as any other: it has its arguments, files and environment, can be killed, and ends as an interpreter ends.
"""

from __future__ import annotations

import atexit
import fcntl
import gc
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import IO, Any

ROOT = Path(__file__).parents[1]
LOADED = (
    "dohyo.sumo_networks.preloaded",
    "dohyo.sumo_networks.envs.driving_env",
    "dohyo.service.app",
    "dohyo.service.cli.commands.train",
    "dohyo.agents.learning.gymnasium.task",
    "dohyo.agents.hierarchical.study.trainings",
    "dohyo.agents.studies.__main__",
)
MAIN = "from dohyo.service.cli import main; main()"
PATIENCE_S = 300.0


class Python:
    """A process that runs what `python -c CODE ARGUMENTS` would.

    Attributes:
        pid: Its number.
        returncode: How it ended, as subprocess says it; None before its end is known.
        streams: Its stdout and stderr, to be read while it runs; only if piped.
    """

    def __init__(
        self,
        code: str,
        *arguments: str,
        cwd: Path = ROOT,
        env: Mapping[str, str] | None = None,
        piped: bool = False,
    ) -> None:
        """Starts it.

        Args:
            code: What it runs.
            arguments: What follows in sys.argv.
            cwd: Its working directory, also the first place where it looks for modules.
            env: Environment variables; by default those of this process.
            piped: Whether `streams` are read instead of `output` and `errors`.
        """
        self._files = tempfile.TemporaryDirectory()
        self._out, self._err = (Path(self._files.name) / name for name in ("out", "err"))
        if piped:
            os.mkfifo(self._out)
            os.mkfifo(self._err)
        else:
            self._out.touch(mode=0o600)  # they can be read before it has begun
            self._err.touch(mode=0o600)
        self.returncode: int | None = None
        self.pid = _server().ask(
            "start",
            code=code,
            argv=["-c", *arguments],
            cwd=str(cwd),
            env=dict(os.environ if env is None else env),
            files=[str(self._out), str(self._err)],
        )
        # Each is opened once the process has opened it.
        self.streams = [path.open() for path in (self._out, self._err)] if piped else []

    def poll(self) -> int | None:
        """Its exit code once it has ended, else None."""
        if self.returncode is None:
            status = _server().ask("poll", pid=self.pid)
            self.returncode = None if status is None else os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait_for(self, condition: Callable[[], bool]) -> None:
        """Waits until a condition holds, which must be before it ends."""
        patience = time.monotonic() + PATIENCE_S
        while True:
            ended = self.poll() is not None  # asked first: the condition may come true just before the end
            if condition():
                return
            assert not ended, self.output() + self.errors()
            assert time.monotonic() < patience
            time.sleep(0.01)

    def send_signal(self, number: signal.Signals) -> None:
        """Sends a signal, unless it is known to have ended."""
        if self.returncode is None:
            os.kill(self.pid, number)

    def end(self, number: signal.Signals | None = None, timeout: float = PATIENCE_S) -> int:
        """Waits for its end, after a signal if there is one to send; returns its exit code."""
        if number is not None:
            self.send_signal(number)
        patience = time.monotonic() + timeout
        while (code := self.poll()) is None:
            assert time.monotonic() < patience, f"still running after {timeout} s: {self.errors()[-2000:]}"
            time.sleep(0.01)
        return code

    def kill(self) -> None:
        """Sends SIGKILL, unless it is known to have ended."""
        self.send_signal(signal.SIGKILL)

    def wait(self, timeout: float = PATIENCE_S) -> int:
        """Waits for its end; returns its exit code."""
        return self.end(timeout=timeout)

    def output(self) -> str:
        """What it has written to stdout."""
        return self._out.read_text()

    def errors(self) -> str:
        """What it has written to stderr."""
        return self._err.read_text()


def dohyo(*arguments: str, cwd: Path = ROOT, env: Mapping[str, str] | None = None, piped: bool = False) -> Python:
    """A `dohyo` command in a process of its own."""
    return Python(MAIN, *arguments, cwd=cwd, env=env, piped=piped)


class _Server:
    """One end of a server: one request, one answer, also where copies of this process share it."""

    def __init__(self) -> None:
        self._turn = tempfile.NamedTemporaryFile()  # noqa: SIM115, it stays as long as this process
        self._owner = os.getpid()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.forked"],
            cwd=ROOT,
            # torchrl imports Ray, which then reads how it proves who it is; clusters of tests have tokens.
            env=os.environ | {"OMP_NUM_THREADS": "1", "RAY_AUTH_MODE": "token"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        atexit.register(self._stop)

    def ask(self, what: str, **facts: object) -> int | None:
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        with open(self._turn.name) as turn:  # its lock is of this process, until it is closed
            fcntl.flock(turn, fcntl.LOCK_EX)
            print(json.dumps({"what": what, **facts}), file=stdin, flush=True)
            assert select.select([stdout], [], [], PATIENCE_S)[0], "the server of processes does not answer"
            answer = json.loads(stdout.readline())
        assert answer is None or isinstance(answer, int)
        return answer

    def _stop(self) -> None:
        if os.getpid() != self._owner:
            return
        # It is not asked to end: a process that was forked here may still hold the other end of its pipe.
        self._process.kill()
        self._process.wait()


@cache
def _server() -> _Server:
    return _Server()


def begin() -> None:
    """Starts the server, so that copies of this process share it; it loads while they begin."""
    _server()


def _serve(requests: IO[str], answers: IO[str]) -> dict[str, Any]:
    """Answers until it is a process that was asked for, whose facts it returns; the server itself does not return."""
    for line in requests:
        request = json.loads(line)
        if request["what"] == "start":
            pid = os.fork()
            if pid == 0:
                return request
            answer = pid
        else:
            ended, status = os.waitpid(request["pid"], os.WNOHANG)
            answer = status if ended else None
        print(json.dumps(answer), file=answers, flush=True)
    os._exit(0)


def _become(request: dict[str, Any]) -> str:
    """Takes over the facts of a process; returns its code."""
    nothing = os.open(os.devnull, os.O_RDONLY)
    out, err = (os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600) for path in request["files"])
    for here, place in ((nothing, 0), (out, 1), (err, 2)):
        os.dup2(here, place)
        os.close(here)
    os.environ.clear()
    os.environ.update(request["env"])
    os.chdir(request["cwd"])
    sys.path[0:1] = ["", *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    sys.argv = request["argv"]
    return str(request["code"])


if __name__ == "__main__":
    for module in LOADED:
        import_module(module)
    import_module("tests.compile_once").install()
    # Else each copy searches these libraries' objects when it ends, which takes two seconds.
    gc.collect()
    gc.freeze()
    code = _become(_serve(sys.stdin, sys.stdout))
    sys.modules["__main__"] = ModuleType("__main__")  # its own processes would load this module as theirs
    exec(compile(code, "<string>", "exec"), vars(sys.modules["__main__"]))
