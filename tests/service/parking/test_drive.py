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
from dohyo.service.episodes.archive import discard, staged_folder
from dohyo.service.evaluations.scoring import is_agent_fault, summary_at
from dohyo.service.parking.drive import park
from dohyo.service.running.gauge import GAUGE_BYTES, Gauge
from dohyo.service.running.order import EpisodeOrder
from dohyo.service.settings import Settings
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.parking.parkers import Greedy

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


def summarised(folder: Path, record: ParkingRecord) -> dict[str, Any]:
    """The lot in the summary of its staged record."""
    (lot,) = summary_at(folder / "lot-s3.json", record, "2.0")["egos"]
    assert isinstance(lot, dict)
    return lot


class Unready(Greedy):
    """Cannot be prepared."""

    def reset(self, seed: int) -> None:
        """See the class."""
        raise RuntimeError("no weights")


def test_an_agent_whose_process_was_ended_has_parked_no_kart(tmp_path: Path) -> None:
    verdict = (Status.AGENT_DEADLINE, "agent never returned; its process was ended")
    record = driven(tmp_path, f"{PARKERS}:Greedy", "parking-three", verdict=verdict)
    assert [(one.ending, one.failure) for one in record.karts] == [("failed", verdict[1])] * 3
    assert is_agent_fault(record)
    lot = summarised(tmp_path, record)
    assert (lot["status"], lot["failure"]) == ("failed: agent did not answer in time", verdict[1])
    assert (lot["success"], lot["parking"]["parked"], lot["duration_s"]) == (False, 0, 0.0)


def test_an_agent_that_is_too_slow_has_failed(tmp_path: Path) -> None:
    record = driven(tmp_path, f"{PARKERS}:Sleeper", act_deadline_s=0.1)
    assert record.karts[0].failure == "agent 'greedy' took longer than 0.1 s"
    assert record.karts[0].ending == "failed"
    assert summarised(tmp_path, record)["status"] == "failed: agent did not answer in time"


@pytest.mark.parametrize(
    ("settings", "status", "failure"),
    [
        ({}, Status.AGENT_RAISED, "act raised "),
        (
            {"answer": [0.0, float("nan"), 0.0]},
            Status.AGENT_ACTION,
            "expected 3 finite numbers as action, got shape (3,)",
        ),
        ({"after": 10**6}, Status.TIMED_OUT, None),
    ],
    ids=["raises", "answers-nan", "goes-on"],
)
def test_the_summary_has_the_kind_of_the_fault_and_its_reason(
    settings: dict[str, Any], status: Status, failure: str | None, tmp_path: Path
) -> None:
    """The record has the reason alone, and the kind lies beside it until the record is archived."""
    entry = f"{PARKERS}:Broken"
    record = driven(tmp_path, entry, info=describe_agent(entry, {}).model_copy(update={"settings": settings}))
    lot = summarised(tmp_path, record)
    if failure is None:
        assert (lot["failure"], Status(lot["status"]).agent_fault) == (None, False)
    else:
        assert lot["status"] == status
        assert lot["failure"].startswith(failure)


def test_an_agent_that_cannot_be_reset_could_not_be_set_up(tmp_path: Path) -> None:
    record = driven(tmp_path, f"{__name__}:Unready")
    assert summarised(tmp_path, record)["status"] == "failed: agent could not be set up"


def test_nothing_of_a_lot_stays_in_staging(tmp_path: Path) -> None:
    settings = Settings(data=tmp_path, _env_file=None)  # type: ignore[call-arg]
    folder = staged_folder(settings, "ev-1")
    driven(folder, f"{PARKERS}:Broken")
    assert len(list(folder.iterdir())) == 3
    discard(settings, "ev-1", "lot-s3")
    assert list(folder.iterdir()) == []


def test_code_that_was_changed_since_it_was_submitted_drives_nothing(tmp_path: Path) -> None:
    old = describe_agent(f"{PARKERS}:Greedy", {}).model_copy(update={"source_sha256": "0" * 64})
    with pytest.raises(InvalidInputError, match="its code has changed since it was submitted"):
        driven(tmp_path, f"{PARKERS}:Greedy", info=old)
    assert not list(tmp_path.iterdir())
