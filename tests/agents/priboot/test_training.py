"""From a recording to a policy that drives: a short recording, a few steps, and the exported file."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from dohyo.agents.learning.files.card import read_card
from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.mcts.predictors import recording as motion
from dohyo.agents.priboot.measurements import SPEED, TARGET
from dohyo.agents.priboot.priboot import Priboot
from dohyo.agents.priboot.recording import record as recording
from dohyo.agents.priboot.recording.dataset import Moments, load_shard
from dohyo.agents.priboot.recording.disturbance import Bursts
from dohyo.agents.priboot.recording.intention import intended
from dohyo.agents.priboot.recording.record import Drive, demonstrator, record_episode, record_moments
from dohyo.agents.priboot.recording.scenarios import NETWORKS, OBSTACLES, MomentRequest, scenario
from dohyo.agents.priboot.training.train import TrainConfig, some_drives, train
from dohyo.agents.priboot.training.views import Compressed, Pictures, load_split
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.units import TICK_S
from tests.agents.driving import drive
from tests.agents.learning.exporting import without_onnx
from tests.worlds import straight_road

SUFFIX = ".safetensors"
ORDER = MomentRequest(samples=1, egos=2, every_s=0.5, episode_s=6.0)


@pytest.fixture(scope="module")
def recorded() -> list[Moments]:
    """Two egos on an empty network: the second one is disturbed."""
    empty = scenario(ORDER, "town-train", 0)
    return record_episode(empty.model_copy(update={"traffic": empty.traffic.model_copy(update={"vehicles": 0})}), ORDER)


@pytest.fixture(scope="module")
def data(recorded: list[Moments], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demonstrations")
    (folder / "dataset.json").write_text("{}")
    for split in ("train", "validation"):
        (folder / split).mkdir()
        (folder / split / "town-train-0000-0.npz").write_bytes(recorded[0].to_bytes())
    return folder


def test_waypoints_are_where_the_ego_goes_from_every_pose(recorded: list[Moments]) -> None:
    first = recorded[0]
    assert len(first) > 5
    steps = np.linalg.norm(np.diff(first.waypoints, axis=2), axis=3)
    np.testing.assert_allclose(steps[:, 1], steps[:, 0], atol=1e-3, err_msg="a displacement changes no distance")
    moving = first.measurements[:, 0, 0] > 0.3
    assert moving.any()
    assert np.abs(first.waypoints[moving, 1] - first.waypoints[moving, 0]).max() > 0.2


def test_no_network_that_judges_is_recorded() -> None:
    judged = {cell.network for name in ("leaderboard", "nocrash") for cell in load_benchmark(name).cells}
    assert not {"adlershof", "town-test"} & set(NETWORKS)
    assert {"adlershof", "town-test"} <= judged


def test_routes_may_have_obstacles_and_nothing_else() -> None:
    events = scenario(dataclasses.replace(ORDER, egos=4, obstacles="lanes"), "town-train", 0).events
    assert {event.kind for event in events} <= set(OBSTACLES["lanes"])
    assert len({event.ego for event in events}) >= 3, "on most routes"
    assert len(events) > len(scenario(dataclasses.replace(ORDER, egos=4), "town-train", 0).events)


def test_an_order_that_cannot_be_recorded_claims_no_folder(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="obstacles named 'walls'"):
        record_moments(dataclasses.replace(ORDER, obstacles="walls"), tmp_path)
    with pytest.raises(InvalidInputError, match="got both, 'doors' and 'a'"):
        record_moments(dataclasses.replace(ORDER, obstacles="doors", learner="a"), tmp_path)
    with pytest.raises(UnknownNameError, match="autopiolt"):
        record_moments(dataclasses.replace(ORDER, demonstrator="autopiolt"), tmp_path)
    with pytest.raises(InvalidInputError, match=r"missing\.onnx"):
        record_moments(dataclasses.replace(ORDER, learner=str(tmp_path / "missing.onnx")), tmp_path)
    assert not list(tmp_path.iterdir())


def test_moments_count_more_often_in_which_the_expert_leaves_a_straight_way(data: Path) -> None:
    moments = load_split(data, "train")
    moments.measurements[:, 0, TARGET] = torch.tensor([1.0, 0.0])
    moments.waypoints[:, 0, -1, 1] = 0.0
    moments.waypoints[3, 0, -1, 1] = 2.0
    moments.measurements[4, 0, TARGET] = torch.tensor([0.7, 0.7])
    moments.waypoints[4, 0, -1, 1] = 2.0
    moments.measurements[:, 0, SPEED] = 0.5
    moments.waypoints[5, 0, -1, 1] = -2.0
    moments.measurements[5, 0, SPEED] = 0.0
    rows = some_drives(moments, TrainConfig(data=data, leaving=4, starting=7)).tolist()
    assert rows.count(3) == 4
    assert rows.count(4) == 1, "the route turns, too"
    assert rows.count(5) == 7, "it stood"
    assert len(rows) == len(moments) + 3 + 6


def test_an_interrupted_recording_goes_on_with_the_same_bytes(
    recorded: list[Moments], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drives = itertools.chain.from_iterable(itertools.repeat(recorded))
    monkeypatch.setattr(recording, "record_episode", lambda *_: [next(drives), next(drives)])
    both = sum(map(len, recorded))
    assert record_moments(dataclasses.replace(ORDER, samples=both + 1), tmp_path) == 2 * both
    monkeypatch.setattr(recording, "record_episode", lambda *_: pytest.fail("recorded again"))
    assert record_moments(dataclasses.replace(ORDER, samples=both + 1), tmp_path) == 2 * both
    with pytest.raises(InvalidInputError, match="expected a dataset made with"):
        record_moments(dataclasses.replace(ORDER, seed=1), tmp_path)
    assert len(load_shard(tmp_path / "train" / "town-train-0000-1.npz")) == len(recorded[1])


def test_a_demonstrator_steers_and_accelerates() -> None:
    assert demonstrator("pdm-closed").spec.name == "pdm-closed"
    with pytest.raises(InvalidInputError, match="'random': expected actions of acceleration_steering"):
        demonstrator("random")


def test_noise_is_swerves_and_stalls_and_leaves_braking_alone() -> None:
    def answers(acceleration: float) -> np.ndarray:
        noise = Bursts(np.random.default_rng(0))
        return np.array([noise.disturbed(np.array([acceleration, 0.0]), 8.0, {}) for _ in range(2000)])

    free, braking = answers(0.0), answers(-6.0)
    stalls, swerves = free[:, 0] <= -2.0, free[:, 1] != 0.0
    assert 0.03 < stalls.mean() < 0.3
    assert 0.03 < swerves.mean() < 0.3
    assert np.abs(free[:, 1]).max() <= 0.1 + 1e-9
    assert (braking[:, 0] == -6.0).all()


def test_an_ego_that_could_go_on_after_a_stop_is_held_for_half_of_the_times() -> None:
    def held(stands_s: float, seed: int) -> int:
        noise = Bursts(np.random.default_rng(seed))
        for _ in range(round(stands_s / TICK_S)):
            noise.disturbed(np.array([-1.0, 0.0]), 0.0, {})
        return sum(noise.disturbed(np.array([2.0, 0.0]), 0.0, {})[0] < 0.0 for _ in range(10))

    after_a_stop = [held(3.0, seed) for seed in range(80)]
    assert 20 < sum(ticks == 10 for ticks in after_a_stop) < 60
    assert all(held(0.3, seed) == 0 for seed in range(20)), "it has hardly stood"


def test_a_held_ego_is_told_where_the_expert_would_go() -> None:
    going, turning = intended(np.array([2.0, 0.0]), 0.0), intended(np.array([2.0, 0.3]), 0.0)
    np.testing.assert_allclose(going[:, 0], [0.2, 0.85, 2.0, 3.7], atol=0.3)
    np.testing.assert_allclose(going[:, 1], 0.0, atol=1e-9)
    assert (turning[1:, 1] > 0.05).all(), "to the left"
    np.testing.assert_allclose(intended(np.array([-2.0, 0.0]), 0.0), 0.0, atol=1e-9)


def test_a_held_moment_goes_and_a_standing_one_does_not() -> None:
    order = scenario(ORDER, "town-train", 0)
    held = Drive(order, 0, Bursts(np.random.default_rng(0)))
    world = straight_road().with_ego(x=50.0).world()
    for tick in range(400):
        held.tick(world, {}, np.array([2.0, 0.0]), tick % 5 == 0)
    moments = held.moments()
    assert len(moments)
    assert {round(float(far), 1) for far in moments.waypoints[:, 0, -1, 0]} == {0.0, 3.6}


def test_a_standing_ego_has_one_picture_for_all_its_views(data: Path) -> None:
    moments = load_split(data, "train")
    pictures = Pictures(moments.paths[0])
    assert int(moments.row.max()) + 1 == len(pictures)
    standing = moments.measurements[:, 0, 0] < 0.05
    assert (moments.row[standing] == moments.row[standing][:, :1]).all()
    rows = np.array([3, 0, len(pictures) - 1, 3])
    np.testing.assert_array_equal(
        Compressed([*moments.paths, *moments.paths])[rows + len(pictures)], pictures.layers[rows]
    )


@pytest.mark.parametrize("picture", ["colours", "masks"])
def test_a_training_writes_a_policy_that_drives(picture: str, data: Path, tmp_path: Path) -> None:
    config = TrainConfig(data=data, steps=3, batch=4, picture=picture, tensorboard=False, validate_every=3)  # type: ignore[arg-type]
    written = train(config, TrainRequest("priboot", tmp_path / "run", False, no_report))
    assert read_card(written).trainer == "priboot"
    worlds = drive(Priboot(policy=written), straight_road().with_ego(x=50.0, speed=5.0), 0.5)
    assert np.isfinite(worlds[-1].egos.position).all()


def test_a_training_goes_on_from_another_and_tunes_the_trunk(data: Path, tmp_path: Path) -> None:
    def trained(name: str, **settings: Any) -> dict[str, torch.Tensor]:
        config = TrainConfig(data=data, steps=2, batch=4, tensorboard=False, validate_every=2, **settings)
        with without_onnx():
            written = train(config, TrainRequest("priboot", tmp_path / name, False, no_report))
        return load_file(written.with_suffix(SUFFIX))

    first = trained("first")
    begin = tmp_path / "first" / f"priboot{SUFFIX}"
    further, tuned = (trained(str(tune), begin=begin, tuned=tune, learning_rate=1e-5) for tune in (False, True))
    learned = "trunk.layers.0.norm.weight"
    assert torch.equal(further[learned], first[learned])
    assert not torch.equal(tuned[learned], first[learned])
    for name, weights in first.items():
        torch.testing.assert_close(tuned[name], weights, atol=1e-3, rtol=0.0, msg=f"{name} did not begin there")
    with pytest.raises(InvalidInputError, match=r"begin: expected weights of a network that reads masks, .* has none"):
        trained("masks", begin=begin, picture="masks")
    with pytest.raises(InvalidInputError, match=r"begin: expected weights .* 'nowhere' has none"):
        trained("nowhere", begin=Path("nowhere"))


def test_routes_of_a_scenario_have_events() -> None:
    drawn = scenario(ORDER, "district", 1)
    assert {event.ego for event in drawn.events} <= {mission.name for mission in drawn.missions}
    assert drawn.events
    assert drawn.missions == motion.scenario(motion.MotionRequest(egos=2), "district", 1).missions
