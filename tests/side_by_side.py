"""Tests side by side: `pytest --processes 6` collects once, and copies of that process run the files.

The workers of pytest-xdist each load the libraries and collect every test, which took a sixth of this suite's time.
The tests of a file stay in one process, which starts what they share once. A process that dies fails its test; another
one runs what is left of its file.
"""

from __future__ import annotations

import atexit
import gc
import os
import pickle
import signal
import struct
import traceback
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby, zip_longest
from multiprocessing import Pipe
from multiprocessing.connection import wait
from typing import Any, NoReturn

import pytest
from _pytest.runner import runtestprotocol

FILE = struct.Struct("i")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the option."""
    text = "run the tests in copies of this process (default: 1, in this process)"
    parser.addoption("--processes", type=int, default=1, metavar="N", help=text)


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session: pytest.Session) -> bool | None:
    """Runs the tests if there are to be several processes; else pytest does."""
    count = session.config.getoption("processes")
    if count < 2 or session.testsfailed or session.config.option.collectonly or not session.items:
        return None
    _First(session, count).run()
    return True


@dataclass
class _Process:
    """A copy of this process, as the first one sees it.

    Attributes:
        pid: Its number.
        left: Tests of its files that it has not begun.
        test: The one that it runs, or None.
    """

    pid: int
    left: list[int] = field(default_factory=list)
    test: int | None = None


class Hooks:
    """What this plugin calls."""

    @staticmethod
    def pytest_copies() -> None:
        """Called before this process is copied, to start what all copies share."""


def pytest_addhooks(pluginmanager: pytest.PytestPluginManager) -> None:
    """Adds them."""
    pluginmanager.add_hookspecs(Hooks)


class _First:
    """The process that has collected: it starts the others, and reports what they tell."""

    def __init__(self, session: pytest.Session, count: int) -> None:
        self._session, self._config = session, session.config
        numbers = range(len(session.items))
        self._files = [list(some) for _, some in groupby(numbers, lambda number: session.items[number].path)]
        self._count = min(count, len(self._files))
        self._running: dict[Any, _Process] = {}
        self._next, writing = os.pipe()
        os.write(writing, b"".join(FILE.pack(number) for number in range(len(self._files))))
        os.close(writing)  # what has been read, nobody else reads, and then it ends
        self._config._tmp_path_factory.getbasetemp()  # type: ignore[attr-defined]  # one for all

    def run(self) -> None:
        """Runs all tests.

        Raises:
            session.Failed: As many have failed as may.
            session.Interrupted: Another plugin has asked for an end.
        """
        self._config.hook.pytest_copies()
        gc.collect()
        gc.freeze()  # pages that no collection touches stay shared
        try:
            for _ in range(self._count):
                self._start([])
            while self._running:
                for end in wait(list(self._running)):
                    self._hear(end)
                if self._session.shouldfail:
                    raise self._session.Failed(self._session.shouldfail)
                if self._session.shouldstop:
                    raise self._session.Interrupted(self._session.shouldstop)
        finally:
            for process in self._running.values():
                os.kill(process.pid, signal.SIGTERM)
            for process in self._running.values():
                os.waitpid(process.pid, 0)

    def _start(self, left: list[int]) -> None:
        ours, theirs = Pipe(duplex=False)
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # an interrupt waits until the copy is known
        pid = os.fork()
        if pid == 0:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
            _Copy(self._session, theirs, self._next, self._files).run(left, [ours, *self._running])
        theirs.close()
        self._running[ours] = _Process(pid, left)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})

    def _hear(self, end: Any) -> None:
        """Takes one message of a process, or notes its end."""
        process = self._running[end]
        try:
            kind, content = end.recv()
        except (EOFError, OSError):
            self._ended(end)
            return
        if kind == "file":
            process.left += self._files[content]
        elif kind == "begins":
            process.test = content
            process.left.remove(content)
        elif kind == "error":
            raise RuntimeError(content)
        elif kind == "warning":
            self._config.hook.pytest_warning_recorded.call_historic(kwargs=content)
        else:
            for data in content:
                hook = self._config.hook.pytest_report_from_serializable
                self._config.hook.pytest_runtest_logreport(report=hook(config=self._config, data=data))
            process.test = None

    def _ended(self, end: Any) -> None:
        """Fails the test that a process died in, and has another one run what is left of its files."""
        process = self._running.pop(end)
        _, status = os.waitpid(process.pid, 0)
        if process.test is not None:
            item = self._session.items[process.test]
            text = f"its process ended with {os.waitstatus_to_exitcode(status)}"
            report = pytest.TestReport(item.nodeid, item.location, {}, "failed", text, "call")
            self._config.hook.pytest_runtest_logreport(report=report)
        elif status:
            raise RuntimeError(f"a process of tests ended with {os.waitstatus_to_exitcode(status)} beside its tests")
        if process.left and not self._session.shouldfail:
            self._start(process.left)


class _Copy:
    """A process that runs tests and tells the first one."""

    def __init__(self, session: pytest.Session, end: Any, files: int, tests: Sequence[list[int]]) -> None:
        self._session, self._end, self._files, self._tests = session, end, files, tests

    def run(self, left: list[int], others: Sequence[Any]) -> NoReturn:
        """Runs some tests, and then those of one file after another, while there are any.

        Args:
            left: Numbers of tests of one file that another process has left.
            others: Ends of pipes that only the first process reads.
        """
        status = 1
        try:
            signal.signal(signal.SIGTERM, signal.default_int_handler)  # SIGINT is ignored behind a shell's "&"
            for end in others:
                end.close()
            capture = self._session.config.pluginmanager.getplugin("capturemanager")
            capture.stop_global_capturing()  # whose files are those of all copies
            capture.start_global_capturing()
            self._session.config.pluginmanager.register(self, "copy")
            for tests in self._next_tests(left):
                for number, following in zip_longest(tests, tests[1:]):
                    self._run(number, following)
            self._session._setupstate.teardown_exact(None)
            status = 0
        except KeyboardInterrupt:
            self._session._setupstate.teardown_exact(None)
        except BaseException:
            self._end.send(("error", traceback.format_exc()))
        finally:
            atexit._run_exitfuncs()
            os._exit(status)

    def _next_tests(self, left: list[int]) -> Iterator[list[int]]:
        """Tests that another process has left, and then those of a file that nobody has taken, while there is one."""
        yield left
        while packed := os.read(self._files, FILE.size):
            (number,) = FILE.unpack(packed)
            self._end.send(("file", number))
            yield self._tests[number]

    def _run(self, number: int, following: int | None) -> None:
        """Runs a test; behind the last one of a file only what the whole session shares stays."""
        self._end.send(("begins", number))
        item = self._session.items[number]
        after = self._session if following is None else self._session.items[following]
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> bool:
        """Runs a test as pytest does, and sends its reports instead of showing them."""
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        hook = item.config.hook.pytest_report_to_serializable
        self._end.send(("reports", [hook(config=item.config, report=report) for report in reports]))
        return True

    @pytest.hookimpl(tryfirst=True)
    def pytest_warning_recorded(
        self, warning_message: warnings.WarningMessage, when: str, nodeid: str, location: Any
    ) -> None:
        """Sends a warning."""
        try:
            pickle.dumps(warning_message)
        except Exception:
            text = Warning(f"{warning_message.category.__name__}: {warning_message.message}")
            place = warning_message.filename, warning_message.lineno
            warning_message = warnings.WarningMessage(text, Warning, *place)
        told = {"warning_message": warning_message, "when": when, "nodeid": nodeid, "location": location}
        self._end.send(("warning", told))
