"""Processes by default: as many as there are processors that this process may use."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from dohyo.evaluation.running.executors import ProcessPool
from dohyo.service.cli.commands import evaluate, prepare
from dohyo.service.cli.commands.evaluate import Engine
from dohyo.service.settings import Settings


@pytest.fixture
def one_processor() -> Iterator[None]:
    """As `taskset -c 0` does it."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    yield
    os.sched_setaffinity(0, before)


@pytest.mark.usefixtures("one_processor")
def test_one_processor_means_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[int] = []
    monkeypatch.setattr(prepare, "_prepare_logs", lambda name, workers: given.append(workers))
    prepare.prepare("quickstart", None)
    prepare.prepare("quickstart", 3)
    assert given == [1, 3]
    assert Settings(_env_file=None).processes == 1
    assert evaluate._executor(Engine.PROCESSES, None, None) == ProcessPool(1)
