"""The fork server itself: loads libraries, then makes a copy of itself for each request.

Started with a search path, the descriptor of a socket for requests, and "module:function" of the preparation. It ends
when the other end of the socket is closed, and its copies with it.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import json
import os
import select
import signal
import socket
import sys
import tempfile
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from dohyo.service.forking.process import NUMBER

_LONGEST_REQUEST = 1 << 20
_MOST_FILES = 8
_PR_SET_PDEATHSIG, _PR_SET_NAME = 1, 15

_GIVEN: set[str] = set()
"""Names of the variables that the server was started with."""


def main() -> None:
    """Serves until the other end is closed."""
    _name("dohyo-fork")
    _GIVEN.update(os.environ)
    gc.disable()  # what is loaded stays, so there is nothing to collect
    _load(sys.argv[3])()
    gc.freeze()
    Copies(socket.socket(fileno=int(sys.argv[2]))).serve()


class Copies:
    """The copies of this process.

    A copy that has ended stays a zombie until the other end of its pipe is closed, so that its number is not given to
    another process before.
    """

    def __init__(self, requests: socket.socket) -> None:
        self._requests = requests
        self._poll = select.poll()
        self._poll.register(requests, select.POLLIN)
        self._running: dict[int, tuple[int, int]] = {}  # by descriptor of the process: its identifier, and its pipe
        self._ended: dict[int, int] = {}  # by pipe: identifier of the process

    def serve(self) -> None:
        """Answers requests until there can be no more."""
        while True:
            for file, _ in self._poll.poll():
                if file in self._running:
                    self._report(file)
                elif file in self._ended:
                    self._forget(file)
                elif not self._answer():
                    return

    def _answer(self) -> bool:
        """Answers the next request; returns whether there was one."""
        content, files, _, _ = socket.recv_fds(self._requests, _LONGEST_REQUEST, _MOST_FILES)
        if not content:
            return False
        pipe, *others = files
        try:
            server, pid = os.getpid(), os.fork()
            if pid == 0:
                _become(json.loads(content), others, server)
            self._watch(pid, pipe)
        except OSError:  # too many processes or files; the closed pipe tells of it
            traceback.print_exc()
            os.close(pipe)
        for other in others:
            os.close(other)
        return True

    def _watch(self, pid: int, pipe: int) -> None:
        try:
            process = os.pidfd_open(pid)
        except OSError:  # nobody could end it later
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            raise
        self._running[process] = pid, pipe
        self._poll.register(process, select.POLLIN)
        _write(pipe, pid)

    def _report(self, process: int) -> None:
        """Writes the exit code of a process that has ended."""
        pid, pipe = self._running.pop(process)
        self._poll.unregister(process)
        os.close(process)
        ended = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
        assert ended is not None
        _write(pipe, ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status)
        self._ended[pipe] = pid
        self._poll.register(pipe, 0)  # POLLERR is always reported

    def _forget(self, pipe: int) -> None:
        self._poll.unregister(pipe)
        os.close(pipe)
        os.waitpid(self._ended.pop(pipe), 0)


def _become(request: dict[str, Any], files: Sequence[int], server: int) -> None:
    """Turns this copy into the process of a request; it never returns."""
    code = 1
    try:
        _end_with(server)
        _name(request["name"])
        os.setsid()
        _close_all_but({0, 1, 2, *files})
        gc.enable()
        _take_variables(request["environment"])
        os.chdir(request["folder"])
        sys.path[:] = request["path"]
        importlib.invalidate_caches()
        tempfile.tempdir = None  # it follows from the environment
        if "numpy" in sys.modules:  # else all copies would draw the same; Python's own generator is seeded by itself
            sys.modules["numpy"].random.seed()
        _load(request["entry"])(*files)
        code = 0
    except BaseException:  # nothing of this copy may go on as a server
        traceback.print_exc()
    finally:
        with suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _take_variables(given: Mapping[str, str]) -> None:
    """Takes the variables of a request; those that libraries have set, such as SUMO's, stay."""
    for name in _GIVEN - given.keys():
        del os.environ[name]
    os.environ.update(given)


def _end_with(server: int) -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != server:  # it has ended before
        os._exit(1)


def _close_all_but(kept: set[int]) -> None:
    for file in sorted(int(name) for name in os.listdir("/proc/self/fd")):
        if file not in kept:
            with suppress(OSError):  # the listing's own
                os.close(file)


def _name(name: str) -> None:
    ctypes.CDLL(None).prctl(_PR_SET_NAME, name.encode(), 0, 0, 0)


def _load(entry: str) -> Any:
    module, _, name = entry.partition(":")
    return getattr(importlib.import_module(module), name)


def _write(pipe: int, number: int) -> None:
    with suppress(BrokenPipeError):  # nobody waits for this process any more
        os.write(pipe, NUMBER.pack(number))
