"""The start of an episode's process is cancelled: no process is left, and the child had the files that were for it."""

from __future__ import annotations

import asyncio
import os
import stat
import subprocess
import threading
from collections.abc import Sequence
from pathlib import Path

import pytest

from dohyo.service.running import process
from dohyo.service.running.gauge import GAUGE_BYTES
from dohyo.service.running.process import EpisodeProcess
from tests.service.served import PATIENCE_S


class SlowFork:
    """Stands for the fork server, which is slow: it looks at its files and starts a process once it may go on."""

    def __init__(self) -> None:
        self.reached, self.may_go_on = threading.Event(), threading.Event()
        self.started: list[subprocess.Popen[bytes]] = []
        self.got: list[tuple[bool, int]] = []

    def __call__(self, template: object, common: object, launch: object, files: Sequence[int]) -> object:
        self.reached.set()
        assert self.may_go_on.wait(PATIENCE_S)
        channel, gauge = map(os.fstat, files)
        self.got.append((stat.S_ISSOCK(channel.st_mode), gauge.st_size))
        self.started.append(subprocess.Popen(["sleep", "600"], start_new_session=True))
        return self.started[-1]


@pytest.fixture
def slow_fork(monkeypatch: pytest.MonkeyPatch) -> SlowFork:
    forking = SlowFork()
    monkeypatch.setattr(process, "fork", forking)
    return forking


@pytest.mark.parametrize("times", [1, 2])
def test_a_cancelled_start_leaves_no_process(tmp_path: Path, slow_fork: SlowFork, times: int) -> None:
    async def main() -> None:
        starting = asyncio.create_task(EpisodeProcess(tmp_path).start())
        assert await asyncio.to_thread(slow_fork.reached.wait, PATIENCE_S)
        for _ in range(times):
            starting.cancel()
            await asyncio.wait([starting], timeout=0.05)
        others = [(tmp_path / str(number)).open("xb") for number in range(8)]  # they get the lowest free descriptors
        slow_fork.may_go_on.set()
        with pytest.raises(asyncio.CancelledError):
            await starting
        for other in others:
            other.close()

    asyncio.run(main())
    assert slow_fork.got == [(True, GAUGE_BYTES)]
    (started,) = slow_fork.started
    assert started.wait(PATIENCE_S) == -9
