"""Lots in an episode process: an agent that was ended, that is too slow, and that was changed since."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import pytest

from dohyo.agents.registry import describe_agent
from dohyo.evaluation.parking.benchmark import LotScenario, load_parking_benchmark
from dohyo.evaluation.parking.lot_files import read_lot, read_lot_motion
from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.service.evaluations.scoring import is_agent_fault, summary_of_lot
from dohyo.service.parking.drive import park
from dohyo.service.running.gauge import GAUGE_BYTES, Gauge
from dohyo.service.running.order import EpisodeOrder
from dohyo.sumo_networks.errors import InvalidInputError

PARKERS = "tests.evaluation.parking.parkers"


def driven(folder: Path, entry: str, benchmark: str = "parking-simple", **order: Any) -> ParkingRecord:
    """The record of one lot."""
    scenario = LotScenario(benchmark=load_parking_benchmark(benchmark), seed=3)
    facts = {"info": describe_agent(entry, {}), "act_deadline_s": 10.0} | order
    given = EpisodeOrder(scenario=scenario, benchmark=("b", "0"), directory=folder, stem="lot-s3", **facts)
    with tempfile.TemporaryFile() as shared:
        shared.truncate(GAUGE_BYTES)
        park(given, scenario, None, Gauge(shared.fileno()))  # type: ignore[arg-type]  # no worker, no channel
    record = read_lot(folder / "lot-s3.json")
    assert len(read_lot_motion(folder / "lot-s3.json", record)) >= 1
    return record


def test_an_agent_whose_process_was_ended_has_parked_no_kart(tmp_path: Path) -> None:
    verdict = (Status.AGENT_DEADLINE, "agent never returned; its process was ended")
    record = driven(tmp_path, f"{PARKERS}:Greedy", "parking-three", verdict=verdict)
    assert [(one.ending, one.failure) for one in record.karts] == [("failed", verdict[1])] * 3
    assert is_agent_fault(record)
    (lot,) = summary_of_lot(record)["egos"]
    assert (lot["success"], lot["parking"]["parked"], lot["duration_s"]) == (False, 0, 0.0)


def test_an_agent_that_is_too_slow_has_failed(tmp_path: Path) -> None:
    record = driven(tmp_path, f"{PARKERS}:Sleeper", act_deadline_s=0.1)
    assert record.karts[0].failure == "agent 'greedy' took longer than 0.1 s"
    assert record.karts[0].ending == "failed"


def test_code_that_was_changed_since_it_was_submitted_drives_nothing(tmp_path: Path) -> None:
    old = describe_agent(f"{PARKERS}:Greedy", {}).model_copy(update={"source_sha256": "0" * 64})
    with pytest.raises(InvalidInputError, match="its code has changed since it was submitted"):
        driven(tmp_path, f"{PARKERS}:Greedy", info=old)
    assert not list(tmp_path.iterdir())
