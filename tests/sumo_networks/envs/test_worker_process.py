"""WorkerProcess: it ends with its parent, whatever it does."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest

from tests.forked import PATIENCE_S, Python

PARENT = """
import sys, time
from dohyo.sumo_networks.envs.worker_process import WorkerProcess
from tests.sumo_networks.envs.hosts import Imported, Sleeper, made

worker = WorkerProcess(0, {host})
worker.send({command!r})
time.sleep({wait_s})
print(worker.pid, flush=True)
time.sleep(1000)
"""
BUSY_S = 2.0


def is_there(pid: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.parametrize(
    ("host", "wait_s"),
    [
        ("Imported()", 0.0),
        ("Imported()", BUSY_S),
        ("made", BUSY_S),
        ("Sleeper", BUSY_S),
    ],
    ids=["begins", "imports", "is made", "acts"],
)
def test_a_worker_ends_with_a_parent_that_is_killed(host: str, wait_s: float) -> None:
    parent = Python(PARENT.format(host=host, command="step", wait_s=wait_s))
    parent.wait_for(lambda: parent.output().endswith("\n"))
    worker = int(parent.output())
    assert is_there(worker)
    parent.end(signal.SIGKILL)
    patience = time.monotonic() + PATIENCE_S / 10
    while is_there(worker):
        assert time.monotonic() < patience
        time.sleep(0.01)
