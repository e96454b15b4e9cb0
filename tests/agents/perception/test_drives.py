"""Drives on disk: all or nothing, memory-mapped, with rows over all drives."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.perception.drives import Drive, Drives, digest_of, write_drives
from dohyo.sumo_networks.errors import InvalidInputError

FACTS = {"scenario": "a", "seed": 3}


def arrays(rows: int, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    pictures = rng.integers(0, 256, (rows, 3, 4, 5), dtype=np.uint8)
    return {"camera": pictures, "action": rng.normal(size=(rows, 2)).astype(np.float32)}


@pytest.fixture
def folder(tmp_path) -> Path:
    (tmp_path / "train").mkdir()
    write_drives(tmp_path / "train" / "a", {"ego0": (arrays(4, 0), FACTS), "ego1": (arrays(1, 1), FACTS)})
    write_drives(tmp_path / "train" / "b", {"ego0": (arrays(3, 2), FACTS)})
    return tmp_path


def test_rows_run_over_all_drives(folder):
    drives = Drives(folder, "train")
    whole = {
        name: np.concatenate([arrays(n, seed)[name] for seed, n in ((0, 4), (1, 1), (2, 3))]) for name in arrays(1)
    }
    assert len(drives) == 8
    assert drives.starts.tolist() == [0, 4, 5, 8]
    index = np.array([7, 0, 4, 4, 3, 5])
    for name, array in drives.rows(index).items():
        assert array.dtype == whole[name].dtype
        np.testing.assert_array_equal(array, whole[name][index])
    np.testing.assert_array_equal(drives.column("camera")[2:6], whole["camera"][2:6])
    np.testing.assert_array_equal(drives.column("action")[-2:], whole["action"][-2:])
    with pytest.raises(IndexError):
        drives.rows(np.array([8]))


def test_values_stay_on_the_disk(folder):
    assert all(
        isinstance(array, np.memmap) for drive in Drives(folder, "train").drives for array in drive.arrays.values()
    )


def test_facts_name_the_drive_and_its_values(folder):
    facts = Drive.load(folder / "train" / "a" / "ego1").facts
    assert facts == {**FACTS, "ego": "ego1", "rows": 1, "sha256": digest_of(arrays(1, 1))}
    assert digest_of(arrays(2)) != digest_of({**arrays(2), "action": arrays(2)["action"] + np.float32(1e-6)})
    assert digest_of({"a": np.zeros((2, 3))}) != digest_of({"a": np.zeros((3, 2))})


def test_the_digest_of_a_set_is_that_of_its_values(folder, tmp_path):
    first, digest = Drives(folder, "train").column("camera").digest, Drives(folder, "train").digest
    assert first != Drives(folder, "train").column("action").digest
    write_drives(folder / "train" / "c", {"ego0": (arrays(3, 2), FACTS)})
    assert Drives(folder, "train").digest != digest


def test_a_scenario_is_complete_or_absent(folder, tmp_path):
    def interrupted():
        yield "ego0", (arrays(2), FACTS)
        raise KeyboardInterrupt

    class Broken(dict):
        def items(self):
            return interrupted()

    with pytest.raises(KeyboardInterrupt):
        write_drives(folder / "train" / "c", Broken())
    assert not (folder / "train" / "c").exists()
    assert len(Drives(folder, "train")) == 8, "the rest of the interrupted one does not count"
    write_drives(folder / "train" / "c", {"ego0": (arrays(2), FACTS)})
    assert len(Drives(folder, "train")) == 10


def test_damaged_other_and_missing_drives_are_one_clear_error(folder):
    with pytest.raises(InvalidInputError, match="found none"):
        Drives(folder, "test")
    with pytest.raises(InvalidInputError, match="expected one of action, camera, got 'lidar'"):
        Drives(folder, "train").column("lidar")
    with pytest.raises(InvalidInputError, match="camera 2, action 3"):
        write_drives(folder / "train" / "z", {"ego0": ({**arrays(3), "camera": arrays(2)["camera"]}, FACTS)})
    path = folder / "train" / "b" / "ego0"
    values = bytearray((path / "action.npy").read_bytes())
    values[-1] ^= 1
    (path / "action.npy").write_bytes(values)
    with pytest.raises(InvalidInputError, match="expected arrays of sha256"):
        Drives(folder, "train").check()
    (path / "action.npy").write_bytes(values[:-10])
    with pytest.raises(InvalidInputError, match=r"ego0' is damaged.*record it again"):
        Drives(folder, "train")
    np.save(path / "action.npy", np.zeros((3, 5), np.float32))
    with pytest.raises(InvalidInputError, match="expected arrays"):
        Drives(folder, "train")
    facts = json.loads((path / "drive.json").read_text())
    (path / "drive.json").write_text(json.dumps({"ego": "x"}))
    with pytest.raises(InvalidInputError, match=r"ego0' is damaged: 'rows'; record it again"):
        Drives(folder, "train")
    (path / "drive.json").write_text(json.dumps(facts | {"rows": 9}))
    with pytest.raises(InvalidInputError, match="expected 9 rows, got action 3, camera 3"):
        Drives(folder, "train")
