"""Recording motion, with real traffic."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.mcts.predictors.dataset import load_shard, shards_of
from dohyo.agents.mcts.predictors.recording import (
    HELD_OUT,
    TRAINING,
    MotionRequest,
    record_motion,
    scenario,
    split_of,
)
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM
from dohyo.sumo_networks.world import ActorKind
from tests.forked import Python

SMALL = MotionRequest(networks=("town-train",), hours=0.008, seed=5, egos=2, episode_s=12.0)  # two episodes


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("motion")
    record_motion(SMALL, out)
    return out


def digests(folder: Path) -> dict[str, str]:
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*.*")}


def test_samples_hold_what_came(recorded):
    shard = load_shard(shards_of(recorded, "train")[0])
    assert len(shard) >= 8
    actors = 0
    for first, later in zip(shard, list(shard)[2:], strict=False):  # two egos in turn: half a second between
        if first.scene.time + 0.5 != pytest.approx(later.scene.time, abs=1e-4):
            continue
        assert first.ego_future_valid.all()
        # Where the first says the ego will be in 0.5 s is where the second's pose is.
        x, y, heading = first.scene.pose
        ahead = first.ego_future[0]
        there = [
            x + ahead[0] * np.cos(heading) - ahead[1] * np.sin(heading),
            y + ahead[0] * np.sin(heading) + ahead[1] * np.cos(heading),
        ]
        assert there == pytest.approx(later.scene.pose[:2], abs=0.01)
        for row, key in enumerate(first.scene.actors.key):
            place = np.flatnonzero(later.scene.actors.key == key)
            if len(place) and first.actors_future_valid[row, 0]:
                moved = first.actors_future[row, 0, :2] - first.scene.actors.position[row]
                assert np.hypot(*moved) < 15.0
                actors += 1
    assert actors > 10


def test_an_interrupted_recording_goes_on_and_ends_with_the_same_bytes(recorded, tmp_path):
    record_motion(replace(SMALL, hours=0.004), tmp_path)
    assert len(shards_of(tmp_path, "train")) == 1
    progress: list[float] = []
    record_motion(SMALL, tmp_path, progress.append)
    assert digests(tmp_path) == digests(recorded)
    assert progress == sorted(progress)
    assert progress[-1] == SMALL.hours


def test_a_fresh_process_gives_the_same_bytes(recorded, tmp_path):
    code = (
        "from pathlib import Path; from dohyo.agents.mcts.predictors.recording import MotionRequest, record_motion;"
        f"record_motion({SMALL!r}, Path({str(tmp_path)!r}))"
    )
    process = Python(code)
    assert process.end() == 0, process.errors()
    assert digests(tmp_path) == digests(recorded)


def test_another_order_in_the_same_folder_is_refused(recorded):
    before = digests(recorded)
    with pytest.raises(InvalidInputError, match="expected a dataset made with"):
        record_motion(replace(SMALL, seed=6), recorded)
    assert digests(recorded) == before


@pytest.mark.parametrize(
    "wrong", [{"networks": ()}, {"hours": 0.0}, {"every_s": 0.01}, {"egos": 0}, {"episode_s": 5.0}]
)
def test_impossible_orders_are_refused(wrong, tmp_path):
    with pytest.raises(InvalidInputError, match="expected"):
        record_motion(replace(SMALL, **wrong), tmp_path)
    assert not list(tmp_path.iterdir())


def test_an_unknown_network_is_refused(tmp_path):
    with pytest.raises(UnknownNameError, match="town-train"):
        record_motion(replace(SMALL, networks=("town-trian",)), tmp_path)


def test_held_out_networks_are_never_trained_on():
    assert not set(TRAINING) & set(HELD_OUT)
    assert {split_of(name, number) for name in HELD_OUT for number in range(20)} == {"test"}
    splits = [split_of("town-train", number) for number in range(20)]
    assert splits.count("validation") == 4
    assert set(splits) == {"train", "validation"}


def test_every_episode_is_another_scenario():
    made = [scenario(SMALL, "town-train", number) for number in range(4)]
    assert len({one.content_hash() for one in made}) == 4
    assert all(one.seed < HELD_OUT_FROM for one in made)
    assert scenario(SMALL, "town-train", 1) == scenario(SMALL, "town-train", 1)
    assert scenario(SMALL, "town-train", 1) != scenario(replace(SMALL, seed=6), "town-train", 1)


def test_another_ego_is_an_actor(recorded):
    kinds = np.concatenate(
        [sample.scene.actors.kind for path in shards_of(recorded, "train") for sample in load_shard(path)]
    )
    assert set(kinds.tolist()) <= {int(kind) for kind in ActorKind}
    assert (kinds == ActorKind.CAR).any()
