"""Reports: how far a training is, for whoever wants to know."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


class Report(NamedTuple):
    """How far a run is.

    Attributes:
        steps: Environment steps so far.
        total: Of them.
        value: What learning is about, such as the mean return of the last round; None: not known yet.
        unit: What that value is.
    """

    steps: int
    total: int
    value: float | None
    unit: str = "return"


Reporter = Callable[[Report], None]


def no_report(report: Report) -> None:
    """Tells nobody."""
