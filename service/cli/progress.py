"""Progress on the terminal: a bar for evaluations and preparations, a line for the steps of an import."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column

from dohyo.service.cli.output import console

NAME_WIDTH, BAR_WIDTH = 24, 8
OTHER_COLUMNS_WIDTH = 34
"""Width of the line's numbers and times with all spaces between columns, characters."""


class ProgressBar:
    """A line that appears with the first progress on work that is not yet done.

    A refusal before it is thus a single line, and work that was done before shows none.
    """

    def __init__(self, title: str, hidden: bool = False) -> None:
        """Prepares the line.

        Args:
            title: Description of the work.
            hidden: Whether nothing is shown.
        """
        note_width = max(1, console.width - NAME_WIDTH - BAR_WIDTH - OTHER_COLUMNS_WIDTH)
        columns = (
            TextColumn("{task.description}", markup=False, table_column=_clipped(NAME_WIDTH)),
            BarColumn(BAR_WIDTH),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}", markup=False, table_column=_clipped(note_width)),
        )
        self._progress = Progress(*columns, console=console, disable=hidden)
        self._task = self._progress.add_task(title, total=None, note="")

    def __enter__(self) -> ProgressBar:
        return self

    def __call__(self, done: float, total: int, note: str = "") -> None:
        """Shows that so many of all are done; a part of one counts as a fraction."""
        if done < total:
            self._progress.start()
        self._progress.update(self._task, completed=done, total=total, note=note)

    def __exit__(self, *_: object) -> None:
        if self._progress.live.is_started:
            self._progress.stop()


@contextmanager
def named_steps() -> Iterator[Callable[[str], None]]:
    """A line on standard error with the name of the current step, on a terminal only."""
    with Console(stderr=True, markup=False).status("") as status:
        yield status.update


@contextmanager
def ended_by_sigterm() -> Iterator[None]:
    """SIGTERM ends the block as Ctrl-C does, so that temporary folders are removed."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _clipped(width: int) -> Column:
    """One-line column; longer text ends in an ellipsis."""
    return Column(max_width=width, no_wrap=True, overflow="ellipsis")
