"""Reports: progress of a training."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


class Report(NamedTuple):
    """Progress of a run.

    Attributes:
        steps: Environment steps so far.
        total: Environment steps in all.
        value: Measure of success, such as the mean return of the last round; None: not known yet.
        unit: Meaning of the value.
    """

    steps: int
    total: int
    value: float | None
    unit: str = "return"


Reporter = Callable[[Report], None]


def no_report(report: Report) -> None:
    """Reports nothing."""
