"""What `dohyo train` lists, and the lines that it writes into a log."""

from __future__ import annotations

import io

from dohyo.agents.learning.files.report import Report
from dohyo.service.cli.train_progress import Lines


class Clock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_log_gets_a_line_every_so_often_and_one_at_the_end() -> None:
    file, clock = io.StringIO(), Clock()
    lines = Lines("toy", file, every_s=30.0, clock=clock)
    for now, steps in ((10.0, 1000), (20.0, 2000), (31.0, 3100), (40.0, 4000), (61.0, 6100), (70.0, 1_000_000)):
        clock.now = now
        lines(Report(steps, 1_000_000, None if steps < 5000 else -3.25, "return"))
    assert file.getvalue().splitlines() == [
        "toy: 3100 of 1000000 steps, 100 steps/s, 2 h 46 min left",
        "toy: 6100 of 1000000 steps, 100 steps/s, 2 h 46 min left, return -3.250",
        "toy: 1000000 of 1000000 steps, 16650 steps/s, return -3.250",
    ]


def test_the_time_left_has_the_unit_that_fits() -> None:
    file, clock = io.StringIO(), Clock()
    lines = Lines("toy", file, every_s=0.0, clock=clock)
    for now, steps in ((0.0, 0), (1.0, 100), (2.0, 99_800)):
        clock.now = now
        lines(Report(steps, 100_000, None))
    first, early, late = file.getvalue().splitlines()
    assert first == "toy: 0 of 100000 steps"
    assert early.endswith("100 steps/s, 17 min left")
    assert late.endswith("49900 steps/s, 0 s left")
