"""Recording: what an agent sees and does is on the disk, and the same order gives the same arrays."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.perception.drives import Drives
from dohyo.agents.perception.recording import RecordingRequest, record_drives, recorded
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from dohyo.sumo_networks.sensors import CameraConfig
from tests.sumo_networks.simulation.drives import on
from tests.worlds import straight_road

CAMERA = CameraConfig(name="small", width=32, height=24)
ORDER = RecordingRequest(sensors=(CAMERA, "speedometer"), every_s=0.5, longest_s=3.0)


def road(name: str, seed: int = 0, metres: float = 300.0) -> Scenario:
    """One ego on a straight road."""
    place = Place(lane="w_e_0", position_m=100.0)
    mission = Mission(name="ego", start=place, goal=place.model_copy(update={"position_m": 100.0 + metres}))
    return on(straight_road(), mission, name=name, seed=seed)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("drives")
    names: list[str] = []
    splits = {"train": [road("a", 1), road("b", 2)], "test": [road("c", 3)]}
    assert record_drives(splits, ORDER, out, names.append) == 18
    assert names == ["a", "b", "c"]
    return out


def test_pictures_actions_and_facts_are_kept(folder):
    drives = Drives(folder, "train")
    assert len(drives) == 12
    rows = drives.rows(np.arange(6))
    assert {name: (array.dtype.name, array.shape[1:]) for name, array in rows.items()} == {
        "small": ("uint8", (3, 24, 32)),
        "speedometer": ("float32", (2,)),
        "action": ("float32", (2,)),
        "time_s": ("float64", ()),
    }
    np.testing.assert_allclose(rows["time_s"], np.arange(6) * 0.5)
    assert rows["small"].std() > 10.0
    assert (np.diff(rows["speedometer"][:, 0]) > 0).all(), "it pulls away"
    assert (rows["action"][:3, 0] > 0).all()
    facts = drives.drives[1].facts
    assert (facts["scenario"], facts["seed"], facts["ego"], facts["rows"]) == ("b", 2, "ego", 6)
    assert facts["agent"]["name"] == "autopilot"
    assert not facts["success"]
    drives.check()


def test_the_same_order_gives_the_same_arrays_and_records_nothing_twice(folder, tmp_path):
    digest = Drives(folder, "train").digest
    written = {path: path.stat().st_mtime_ns for path in folder.rglob("*.npy")}
    record_drives({"train": [road("a", 1), road("b", 2)]}, ORDER, folder)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.npy")} == written
    record_drives({"train": [road("a", 1), road("b", 2)]}, ORDER, tmp_path)
    assert Drives(tmp_path, "train").digest == digest


def test_a_drive_ends_at_the_goal():
    (arrays, facts) = recorded(road("near", metres=20.0), ORDER.model_copy(update={"longest_s": 60.0}))["ego"]
    assert facts["success"]
    assert len(arrays["action"]) < 30


def test_another_or_impossible_order_is_refused(folder, tmp_path):
    with pytest.raises(InvalidInputError, match="expected a dataset made with"):
        record_drives({}, ORDER.model_copy(update={"every_s": 0.1}), folder)
    with pytest.raises(UnknownNameError, match="autopilott"):
        record_drives({"train": [road("a")]}, ORDER.model_copy(update={"agent": "autopilott"}), tmp_path)
    with pytest.raises(ValueError, match="every_s"):
        RecordingRequest(every_s=0.01)
    assert json.loads((folder / "dataset.json").read_text())["sensors"][0]["width"] == 32


@pytest.mark.parametrize(("setting", "value"), [("every_s", 0.25), ("longest_s", 0.04)])
def test_times_that_are_no_ticks_are_refused(setting, value):
    with pytest.raises(ValueError, match=setting):
        RecordingRequest(**{setting: value})
    assert RecordingRequest(every_s=0.3).every_s == 0.3
