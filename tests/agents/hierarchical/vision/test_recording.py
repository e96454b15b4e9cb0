"""Recording pictures, with real traffic."""

from __future__ import annotations

import hashlib
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.hierarchical.vision.dataset import SCHEMA, load_shard, load_split
from dohyo.agents.hierarchical.vision.recording import (
    OFF,
    Disturbance,
    PictureRequest,
    drawn_off,
    labels,
    record_episode,
    record_pictures,
    scenario,
)
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.rendering.labels import Label
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import LightState
from tests.forked import Python
from tests.worlds import lit_crossing

SMALL = PictureRequest(images=12, seed=3, egos=2, every_s=1.0, episode_s=3.0)  # an episode each


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("semantic")
    assert record_pictures(SMALL, out) == 36
    return out


def digests(folder: Path) -> dict[str, str]:
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*.npz")}


def test_splits_have_their_own_scenarios(recorded):
    assert {split: [path.name for path in sorted((recorded / split).iterdir())] for split in os.listdir(recorded)
            if split != "dataset.json"} == {
        "train": ["town-train-0000.npz"],
        "validation": ["town-train-0001.npz"],
        "test": ["town-test-0000.npz"],
    }  # fmt: skip
    numbers = [(split, name, number) for split, name, number in PictureRequest().episodes()]
    assert len({(name, number) for _, name, number in numbers}) == len(numbers)
    assert {name for split, name, _ in numbers if split == "test"} == {"town-test"}
    assert {name for split, name, _ in numbers if split != "test"} == {"town-train"}
    made = {scenario(SMALL, "town-train", number).content_hash() for number in range(3)}
    assert len(made) == 3


def test_pictures_show_roads_and_one_of_two_cameras_is_off(recorded):
    shown = load_split(recorded, "train")
    assert shown.pictures.shape == (12, 80, 160)
    assert all((picture == Label.ROAD).any() for picture in shown.pictures)
    assert not shown.mounting[0::2].any()
    assert (np.abs(shown.mounting[1::2]).max(axis=1) > 0.0).all()
    assert all((a != b).any() for a, b in zip(shown.pictures[0::2], shown.pictures[1::2], strict=True))
    assert (shown.impact_m[0::2] == shown.impact_m[1::2]).all(), "the label is the vehicle's, not the camera's"


@given(st.integers(0, 2**32))
def test_a_camera_is_off_within_its_bounds(seed):
    off = drawn_off(np.random.default_rng(seed))
    assert (np.abs(off) <= list(OFF.values())).all()


@given(st.integers(0, 2**32), st.floats(-0.9, 4.0), st.floats(-1.0, 1.0))
def test_noise_is_within_a_tenth_of_full_and_holds_half_a_second(seed, acceleration, steering):
    noise = Disturbance(np.random.default_rng(seed))
    out = np.array([noise.disturbed(np.array([acceleration, steering])) for _ in range(15)])
    assert np.abs(out[:, 0] - acceleration).max() <= 0.4 + 1e-9
    assert np.abs(out[:, 1] - steering).max() <= 0.1 + 1e-9
    for part in np.split(out, 3):
        assert (part == part[0]).all()
    assert (out[0] != out[5]).any()


def test_who_brakes_is_not_disturbed_in_it():
    noise = Disturbance(np.random.default_rng(0))
    assert noise.disturbed(np.array([-3.0, 0.0]))[0] == -3.0


def test_labels_by_hand():
    line = lit_crossing().stop_line("w_c_0")
    scene = lit_crossing().with_ego(x=line - 32.25).with_actor(x=line - 10.0).with_lights(s=LightState.RED)
    world = scene.world()
    names = ("objects", "path", "junctions_ahead")
    impact, event, light = labels({sensor.name: sensor.read(world, 0) for sensor in make_sensors(names)})
    assert impact == pytest.approx(22.25 - 4.5, abs=0.05)
    assert event == pytest.approx(30.0, abs=0.6)
    assert light == LightState.RED


def test_an_episode_is_the_same_each_time(recorded):
    order = SMALL
    again = record_episode(scenario(order, "town-train", 0), order)
    there = load_shard(recorded / "train" / "town-train-0000.npz")
    for name in SCHEMA:
        np.testing.assert_array_equal(getattr(again, name), getattr(there, name))


def test_a_killed_recording_goes_on_and_ends_with_the_same_bytes(recorded, tmp_path):
    code = (
        "import time; from pathlib import Path;"
        "from dohyo.agents.hierarchical.vision.recording import PictureRequest, record_pictures;"
        f"record_pictures({SMALL!r}, Path({str(tmp_path)!r}), lambda share: time.sleep(600 * (share > 0.5)))"
    )
    process = Python(code)
    process.wait_for(lambda: bool(list(tmp_path.rglob("*.npz"))))
    process.end(signal.SIGKILL)
    assert 1 <= len(digests(tmp_path)) < 3
    shares: list[float] = []
    record_pictures(SMALL, tmp_path, shares.append)
    assert digests(tmp_path) == digests(recorded)
    assert shares == [pytest.approx(n / 3) for n in (1, 2, 3)]


def test_another_order_in_the_same_folder_is_refused(recorded):
    before = digests(recorded)
    with pytest.raises(InvalidInputError, match="expected a dataset made with"):
        record_pictures(replace(SMALL, seed=4), recorded)
    assert digests(recorded) == before


@pytest.mark.parametrize("wrong", [{"images": 0}, {"egos": 0}, {"every_s": 0.01}, {"episode_s": 0.5}])
def test_impossible_orders_are_refused(wrong, tmp_path):
    with pytest.raises(InvalidInputError, match="expected"):
        record_pictures(replace(SMALL, **wrong), tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_damaged_shard_is_one_clear_error(recorded, tmp_path):
    content = (recorded / "train" / "town-train-0000.npz").read_bytes()
    path = tmp_path / "train" / "a.npz"
    path.parent.mkdir()
    for damaged in (content[: len(content) // 2], content[:40] + b"\0" * 40 + content[80:], b""):
        path.write_bytes(damaged)
        with pytest.raises(InvalidInputError, match=r"a\.npz") as raised:
            load_split(tmp_path, "train")
        assert "\n" not in str(raised.value)
    there = load_shard(recorded / "train" / "town-train-0000.npz")
    for name, array in (("impact_m", there.impact_m * np.nan), ("signal", there.signal[:-1]), ("pictures", None)):
        arrays = {key: getattr(there, key) for key in SCHEMA} | {name: array}
        np.savez(path, schema=np.int32(1), **{key: value for key, value in arrays.items() if value is not None})
        with pytest.raises(InvalidInputError, match=r"a\.npz"):
            load_shard(path)
    with pytest.raises(InvalidInputError, match="dohyo dataset semantic"):
        load_split(tmp_path, "validation")
