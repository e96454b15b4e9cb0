"""GRIAD's driving: choices, target speed, reward, episodes, frozen features, and the agent of a training."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import torch

from dohyo.agents.gri.demonstrated_replay import GriConfig
from dohyo.agents.gri.driving.choices import ACCELERATIONS, STEERING, TABLE, nearest
from dohyo.agents.gri.driving.missions import draw_mission, draw_varied
from dohyo.agents.gri.driving.pictures import LATENTS, PICTURES, Pictures
from dohyo.agents.gri.driving.target_speed import FALL_M, FREE_M_S, STOP_M, target_speed
from dohyo.agents.gri.driving.task import ENCODERS, DrivingTask
from dohyo.agents.gri.griad import Griad
from dohyo.agents.gri.training import GRI, GriRunConfig
from dohyo.agents.hierarchical.vision.latents import Encoder
from dohyo.agents.learning.algorithms.iqn import IqnPolicy
from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.networks.modules import ObservationEncoder, QuantileNetwork
from dohyo.agents.learning.policies.export import export
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.submission import write_submission
from dohyo.evaluation.agent import Mission
from dohyo.service.policies.checks import check_policy
from dohyo.sumo_networks.conditions import TRAIN
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.rendering.labels import Label
from dohyo.sumo_networks.routes.command import Command
from dohyo.sumo_networks.scenario import Place
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.sensors.path import BEHIND, POINTS
from dohyo.sumo_networks.world import LightState
from tests.agents.endless_driving.test_agent import answers

CONFIG = Path(__file__).parents[4] / "agents" / "gri" / "configs" / "griad.toml"
FRONT_M = VehicleParameters().length / 2
EMPTY_ROAD = 21
"""Seed of a short mission without traffic."""


def road(curvature: float = 0.0, light_m: float | None = None, actor: tuple[float, float] | None = None) -> dict:
    """A straight road at 50 km/h, with a red light and an actor (x, y) of a metre's length if wanted."""
    path = np.zeros((POINTS, 6), np.float32)
    path[:, 0], path[:, 3], path[:, 4] = np.arange(POINTS) - BEHIND, curvature, 50 / 3.6
    junctions = np.array([[1000.0, 1000.0, -1.0, 0.0]] * 4, np.float32)
    objects = np.zeros((48, 8), np.float32)
    objects[:, 0] = -1.0
    if light_m is not None:
        junctions[0] = light_m, light_m + 10.0, LightState.RED, 0.0
    if actor is not None:
        objects[0] = 0.0, *actor, 0.0, 0.0, 1.0, 1.0, 1.0
    return {"path": path, "junctions_ahead": junctions, "objects": objects}


def test_there_are_108_choices_and_each_is_nearest_to_itself():
    assert len({tuple(row) for row in TABLE.tolist()}) == 27 * 4 == 108
    assert [nearest(row) for row in TABLE] == list(range(108))
    row = TABLE[nearest(np.array([-7.0, 0.02]))]
    assert row[0] == min(ACCELERATIONS)
    assert abs(row[1] - 0.02) == pytest.approx(np.abs(STEERING - 0.02).min(), abs=1e-6)


def test_the_target_speed_is_40_km_h_and_falls_linearly_to_what_must_be_stopped_for():
    assert target_speed(road()) == pytest.approx(40 / 3.6)
    assert target_speed(road(curvature=0.1)) == pytest.approx(5.0), "2.5 m/s^2 in a bend of 10 m"
    half = STOP_M + FALL_M / 2
    assert target_speed(road(light_m=half)) == pytest.approx(FREE_M_S / 2)
    assert target_speed(road(light_m=STOP_M)) == 0.0
    assert target_speed(road(actor=(FRONT_M + half + 0.5, 0.0))) == pytest.approx(FREE_M_S / 2)
    assert target_speed(road(actor=(FRONT_M + half, 3.0))) == pytest.approx(FREE_M_S), "beside the path"
    assert target_speed(road(actor=(-10.0, 0.0))) == pytest.approx(FREE_M_S), "behind"


def test_the_autopilot_is_rewarded_and_who_leaves_the_lane_ends_with_minus_1(monkeypatch):
    encoded = []
    latent = Encoder.latent
    monkeypatch.setattr(Encoder, "latent", lambda self, seen: encoded.append(1) or latent(self, seen))
    env = DrivingTask("pictures").make_env(0)
    try:
        first, _ = env.reset(seed=1)
        rewards = [env.step(env.expert_action())[1] for _ in range(60)]
        assert all(-1.0 < reward <= 1.0 for reward in rewards)
        assert np.mean(rewards[30:]) > 0.6
        seen, _ = env.reset(seed=1)
        assert np.array_equal(seen["features"], first["features"])
        encoded.clear()
        left = nearest(np.array([2.0, 1.0]))
        steps, terminated = 0, False
        while not terminated:
            steps += 1
            before, (seen, reward, terminated, _, info) = seen, env.step(left)
            if terminated:
                continue
            kept = slice(2 * LATENTS, PICTURES * LATENTS)
            assert np.array_equal(seen["features"][: 2 * LATENTS], before["features"][kept]), "two ticks are new"
    finally:
        env.close()
    assert (reward, info["off_lane"], info["success"]) == (-1.0, 1.0, False)
    assert 2 * steps - 1 <= len(encoded) <= 2 * steps, "every tick's picture is encoded once"


def test_a_goal_cuts_an_episode_and_is_no_terminal_state():
    """Of a terminal state nothing is to be expected: a learner that is rewarded for driving on would stop before it."""
    env, over = DrivingTask().make_env(0), False
    try:
        env.reset(seed=EMPTY_ROAD)
        while not over:
            *_, terminated, truncated, info = env.step(env.expert_action())
            over = terminated or truncated
    finally:
        env.close()
    assert info["success"]
    assert (terminated, truncated) == (False, True)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tiny training with GRIAD's configuration, on the state."""
    settings = (
        "env=driving-state",
        "steps=120",
        "processes=1",
        "explorers=2",
        "episodes=1",
        "evaluate_every=120",
        "shown=2",
    )
    sizes = ("iqn.hidden=[8]", "iqn.batch=4", "iqn.round_steps=20", "iqn.learning_starts=40", "checkpoint_every=60")
    config = read_settings(GriRunConfig, CONFIG, (*settings, *sizes, "tensorboard=false"))
    assert config.gri == GriConfig(p_demo=0.25, unit="steps", demo_reward=1.0)
    out = tmp_path_factory.mktemp("griad")
    GRI.train(config, TrainRequest("gri", out, False, no_report))
    return out


def test_griad_trains_from_explorers_and_demonstrators_three_to_one(trained):
    with (trained / "metrics.csv").open() as file:
        last = list(csv.DictReader(file))[-1]
    # The last demonstration may be ahead of the share by its own length, of at most 300 steps.
    assert 0.25 <= float(last["replay_demonstrated"]) <= 300 / 420
    assert int(last["updates"]) > 0


def test_the_policy_of_a_training_drives_as_an_agent(trained):
    agent = Griad(str(trained / "best.onnx"))
    sensors = make_sensors(agent.spec.sensors)
    seen = {sensor.name: np.zeros(sensor.space.shape, sensor.space.dtype) for sensor in sensors}
    agent.warm_up()
    agent.reset(Mission(start=Place(lane="a", position_m=0.0), goal=Place(lane="b", position_m=0.0)), 0)
    assert agent.spec.control == "acceleration_steering"
    assert agent.act(seen).tolist() in TABLE.tolist()
    assert agent.spec.track == ENCODERS["state"].track == "privileged"
    assert ENCODERS["pictures"].track == "sensors"


def test_a_policy_of_another_task_is_refused(trained):
    with pytest.raises(InvalidInputError, match="no policy"):
        Griad("/nowhere.onnx")
    shipped = Path(__file__).parents[4] / "agents" / "priboot" / "checkpoints" / "priboot.onnx"
    with pytest.raises(InvalidInputError, match="expected a policy of the driving task, it sees"):
        Griad(str(shipped))


def test_a_service_takes_the_submission_of_pictures_and_it_drives_as_the_agent(tmp_path):
    torch.manual_seed(0)
    encoder = ObservationEncoder(Pictures.space)
    network = QuantileNetwork(encoder.features, len(TABLE), (16,), dueling=True, noise=0.5)
    export(IqnPolicy(encoder, network, 8), Pictures.space, tmp_path / "best", {})
    file = tmp_path / "submission.onnx"
    spec = write_submission("griad", tmp_path / "best.onnx", file)
    agent, rng = Griad(tmp_path / "best.onnx"), np.random.default_rng(0)
    agent.reset(Mission(start=Place(lane="a", position_m=0.0), goal=Place(lane="b", position_m=0.0)), 0)
    observations = [
        {
            "camera_semantic": np.full((1, 80, 160), rng.integers(len(Label)), np.uint8),
            "speedometer": rng.uniform(0.0, 10.0, 2).astype(np.float32),
            "navigation": np.array([rng.integers(len(Command)), 50.0, 10.0], np.float32),
        }
        for _ in range(8)
    ]
    expected = [agent.act(observation) for observation in observations]
    assert len({tuple(row) for row in np.array(expected).tolist()}) > 1
    np.testing.assert_allclose(answers(file, observations), expected, atol=1e-6)
    assert "state_latents" in check_policy(file.read_bytes(), spec).states


def test_the_exact_state_is_no_sensor_of_a_service(trained, tmp_path):
    with pytest.raises(InvalidInputError, match="expected a policy of pictures"):
        write_submission("griad", trained / "best.onnx", tmp_path / "submission.onnx")


def test_varied_missions_are_the_same_under_the_four_conditions_of_training_in_turn():
    drawn = [draw_varied(seed) for seed in range(EMPTY_ROAD, EMPTY_ROAD + 8)]
    plain = [draw_mission(seed) for seed in range(EMPTY_ROAD, EMPTY_ROAD + 8)]
    assert [one.missions for one in drawn] == [one.missions for one in plain]
    assert {one.conditions for one in plain} == {"clear"}
    assert sorted(one.conditions for one in drawn) == sorted([*TRAIN] * 2)


def test_a_varied_task_is_driven_in_its_conditions():
    settings = read_settings(GriRunConfig, None, ("env=driving-affordances-varied",))
    assert settings.task.varied
    assert settings.task.name == "driving-affordances-varied"
    rainy = next(seed for seed in range(EMPTY_ROAD, EMPTY_ROAD + 4) if draw_varied(seed).conditions == "heavy-rain")
    seen = []
    for task in (settings.task, DrivingTask("affordances")):
        env = task.make_env(0)
        seen.append(env.reset(seed=rainy)[0]["affordances"])
        env.close()
    assert seen[0].shape == seen[1].shape
    assert not np.allclose(*seen), "the cameras see rain"
