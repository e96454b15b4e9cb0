"""The wall-clock limit of a drive: half of it is the agent's, so that the end of the limit has one clear cause."""

from __future__ import annotations

import asyncio
import tempfile
from pathlib import Path

import numpy as np
import pytest

from dohyo.evaluation.agent import Observation
from dohyo.service.running.gauge import GAUGE_BYTES, Gauge
from dohyo.service.running.order import EpisodeOrder
from dohyo.service.running.process import End, EpisodeProcess, Outcome
from tests.evaluation.agents import Steady
from tests.service.served import info_of, short

SLUGGISH = "tests.evaluation.agents:Sluggish"
HANGS = "tests.evaluation.agents:Hangs"


class Stands(Steady):
    """Never moves, so that its drive lasts for long."""

    def act(self, observation: Observation) -> np.ndarray:
        return np.zeros(2)


def order(folder: Path, entry: str, act_deadline_s: float) -> EpisodeOrder:
    (scenario,) = short().scenarios([0])
    info, benchmark = info_of(entry), ("b", "0" * 64)
    facts = {"scenario": scenario, "info": info, "benchmark": benchmark, "directory": folder, "stem": info.name}
    return EpisodeOrder(**facts, act_deadline_s=act_deadline_s)  # type: ignore[arg-type]


async def drive(folder: Path, entry: str, limit_s: float, act_deadline_s: float = 10.0) -> Outcome:
    process = EpisodeProcess(folder)
    await process.start()
    try:
        return await process.drive(order(folder, entry, act_deadline_s), limit_s)
    finally:
        await process.close()


def test_an_agent_that_takes_half_of_the_limit_has_failed(tmp_path: Path) -> None:
    outcome = asyncio.run(drive(tmp_path, SLUGGISH, 20.0))
    assert outcome.end is End.HUNG
    assert "agent took more than 10 s" in outcome.text


def test_a_drive_beyond_the_limit_is_the_machines_fault_where_the_agent_was_fast(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dohyo.service.running.process.POLL_S", 0.002)
    outcome = asyncio.run(drive(tmp_path, f"{__name__}:Stands", 0.2))
    assert outcome.end is End.FAILED
    assert "simulation took more than 0.2 s; its agent took 0 s" in outcome.text


def test_a_decision_that_still_runs_is_no_time_of_the_simulation(tmp_path: Path) -> None:
    """A slow decision near the limit would make its drive the machine's fault, which is driven again."""
    outcome = asyncio.run(drive(tmp_path, HANGS, 5.0, act_deadline_s=6.5))
    assert outcome.end in (End.HUNG, End.FINISHED), outcome.text


def test_the_time_in_calls_of_the_agent_is_summed(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr("dohyo.service.running.gauge.time.monotonic", lambda: clock[0])
    with tempfile.TemporaryFile() as shared:
        shared.truncate(GAUGE_BYTES)
        process, server = Gauge(shared.fileno()), Gauge(shared.fileno())
    process.begin()
    for ego, seconds in ((0, 1.0), (1, 2.5)):
        process.watch(10.0, ego)
        assert server.ego == ego
        assert server.due == clock[0] + 10.0
        clock[0] += seconds
        assert server.deciding_s == seconds
        process.watch(0.0)
        assert (server.due, server.deciding_s) == (0.0, 0.0)
        clock[0] += 7.0
    process.watch(10.0, 0)
    process.watch(0.0, 0)
    assert (server.began, server.agent_s, server.ego, server.slowest) == (100.0, 3.5, 0, 1)
    process.clear()
    assert (server.began, server.agent_s, server.slowest) == (0.0, 0.0, 0)


def test_a_worker_has_no_deadline_here_and_its_drive_begins_with_its_first_decision() -> None:
    with tempfile.TemporaryFile() as shared:
        shared.truncate(GAUGE_BYTES)
        gauge = Gauge(shared.fileno())
    assert gauge.began == 0.0
    gauge.watch_worker(86_400.0)
    began = gauge.began
    assert began > 0.0
    assert gauge.due == 0.0
    gauge.watch_worker(0.0)
    gauge.watch_worker(86_400.0)
    assert gauge.began == began
