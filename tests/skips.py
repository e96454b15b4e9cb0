"""In CI a skipped test is a failure, but for what no installation can change: CI=true, as `.ci/run` sets it."""

from __future__ import annotations

import os
from collections.abc import Generator

import pytest

OF_THE_PLATFORM = ("/proc is Linux's", "only root can become somebody else", "no file system can be mounted here")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Turns a skip into a failure that says why it was one."""
    report = yield
    reason = report.longrepr[2] if report.skipped and isinstance(report.longrepr, tuple) else ""
    if reason and os.environ.get("CI") == "true" and not any(known in reason for known in OF_THE_PLATFORM):
        report.outcome = "failed"
        report.longrepr = f"{reason}: in CI nothing may be skipped (tests/skips.py)"
    return report
