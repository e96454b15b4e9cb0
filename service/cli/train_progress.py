"""Progress of a training: a bar on a terminal, otherwise a plain line every so often."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from dohyo.service.cli.output import console

if TYPE_CHECKING:
    from dohyo.agents.learning.files.report import Report

EVERY_S = 30.0
"""Time between two lines where the output is no terminal, s."""


@contextmanager
def progress(name: str) -> Iterator[Callable[[Report], None]]:
    """Shows steps, steps per second, time left and the trained value of the reports that the block gives."""
    if not console.is_terminal:
        yield Lines(name, sys.stderr)
        return
    columns = (TextColumn(name), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[told]}"))
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True) as bars:
        bar, rate = bars.add_task(name, total=None, told=""), Rate()

        def report(done: Report) -> None:
            told = f"{rate.after(done.steps):.0f} steps/s{_value(done)}"
            bars.update(bar, total=done.total, completed=done.steps, told=told)

        yield report


class Lines:
    """Writes the progress as lines, for logs: the first after some seconds, the last at the end."""

    def __init__(self, name: str, file: TextIO, every_s: float = EVERY_S, clock: Callable[[], float] = time.monotonic):
        """Begins.

        Args:
            name: First word of every line.
            file: Where the lines go.
            every_s: Time between two lines, s.
            clock: Present time, s.
        """
        self._name, self._file, self._every_s, self._clock = name, file, every_s, clock
        self._rate, self._written_s = Rate(clock), clock()

    def __call__(self, done: Report) -> None:
        """Writes a line if one is due."""
        rate, now = self._rate.after(done.steps), self._clock()
        if now - self._written_s < self._every_s and done.steps < done.total:
            return
        self._written_s = now
        left = f", {_duration((done.total - done.steps) / rate)} left" if rate and done.steps < done.total else ""
        speed = f", {rate:.0f} steps/s" if rate else ""
        print(
            f"{self._name}: {done.steps} of {done.total} steps{speed}{left}{_value(done)}", file=self._file, flush=True
        )


class Rate:
    """Steps per second since the first report of this session."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._first: tuple[float, int] | None = None

    def after(self, steps: int) -> float:
        """Rate with this number of steps done now; 0 before it can be known."""
        now = self._clock()
        if self._first is None:
            self._first = now, steps
        began, before = self._first
        return (steps - before) / (now - began) if now > began else 0.0


def _value(done: Report) -> str:
    return "" if done.value is None else f", {done.unit} {done.value:.3f}"


def _duration(seconds: float) -> str:
    """Time in words, such as "2 h 05 min", "7 min" or "40 s"."""
    minutes = round(seconds / 60)
    if seconds < 60:
        return f"{seconds:.0f} s"
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"
