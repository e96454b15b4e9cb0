"""Driving by A-VIS: one encoder for the producer and the agent, and one drive in training and as an agent."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import torch

from dohyo.agents.gri.driving import affordances
from dohyo.agents.gri.driving.affordances import Affordances, Classification, Untrained
from dohyo.agents.gri.driving.choices import CONTROL, TABLE
from dohyo.agents.gri.driving.missions import draw_mission
from dohyo.agents.gri.driving.pictures import PICTURES
from dohyo.agents.gri.driving.task import EGO, ENCODERS, REPEAT, DrivingTask
from dohyo.agents.gri.griad import Griad
from dohyo.agents.gri.training import GRI, GriRunConfig
from dohyo.agents.gri.vision.cameras import CAMERAS, pictures
from dohyo.agents.gri.vision.frozen import FEATURES, FrozenEncoder
from dohyo.agents.learning.algorithms.iqn import IqnPolicy
from dohyo.agents.learning.experience.demonstrations import Demonstrations
from dohyo.agents.learning.files.card import read_card
from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.networks.modules import ObservationEncoder, QuantileNetwork
from dohyo.agents.learning.policies.export import export
from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.submission import write_submission
from dohyo.evaluation.agent import Mission
from dohyo.service.policies.checks import check_policy
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Place
from tests.agents.endless_driving.test_agent import answers

CONFIG = Path(__file__).parents[4] / "agents" / "gri" / "configs" / "griad.toml"
MISSION = 21
"""Seed of a short mission without traffic."""
LENGTH = PICTURES * FEATURES


@pytest.fixture
def policy(tmp_path: Path) -> Path:
    """An untrained policy of affordances."""
    torch.manual_seed(3)
    encoder = ObservationEncoder(Affordances.space)
    network = QuantileNetwork(encoder.features, len(TABLE), (16,), dueling=True, noise=0.5)
    export(IqnPolicy(encoder, network, 8), Affordances.space, tmp_path / "best", {})
    return tmp_path / "best.onnx"


def driven_in_training(policy: Path, choices: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Encodings and actions at each choice of a policy, in the environment of the training."""
    env, chooses, out = DrivingTask("affordances").make_env(0), OnnxPolicy(policy), []
    try:
        observation, _ = env.reset(seed=MISSION)
        for _ in range(choices):
            choice = int(chooses(observation))
            out.append((observation["affordances"], TABLE[choice]))
            observation, *_ = env.step(choice)
    finally:
        env.close()
    return out


def driven_as_an_agent(policy: Path, choices: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """The same of the agent, in the environment of evaluations."""
    scenario, agent, sight, out = draw_mission(MISSION), Griad(policy), Affordances(), []
    with closing(DrivingEnv(scenario, agent.spec.sensors, CONTROL, reward=None)) as env:
        observations, _ = env.reset()
        for one in (agent, sight):
            one.reset(scenario.missions[0], scenario.seed)
        for _ in range(choices * REPEAT):
            action = agent.act(observations[EGO])
            out.append((sight.encode(observations[EGO])["affordances"], action))
            observations, *_ = env.step({EGO: action})
    return out[::REPEAT]


def test_the_policy_drives_the_same_in_training_and_as_an_agent(policy):
    """The encodings of the producer are those of the agent, to the bit, and so are the actions."""
    pairs = zip(driven_in_training(policy, 12), driven_as_an_agent(policy, 12), strict=True)
    for (encoded, action), (again, same) in pairs:
        assert np.array_equal(encoded, again)
        assert np.array_equal(action, same)
    agent = Griad(policy)
    assert agent.spec.track == "sensors"
    assert agent.files == (policy, *Affordances.files)


def test_a_state_is_four_ticks_of_what_the_frozen_encoder_says():
    sight, frozen = Affordances(), FrozenEncoder(Affordances.files[0])
    rng = np.random.default_rng(0)
    observations = [
        {
            **{name: rng.integers(255, size=(3, 64, 64), dtype=np.uint8) for name in sight.sensors[:3]},
            "speedometer": np.array([5.0, 0.0], np.float32),
            "navigation": np.array([2.0, 50.0, 10.0], np.float32),
        }
        for _ in range(5)
    ]
    told = [sight.encode(one) for one in observations]
    single = [frozen.features(pictures(one)) for one in observations]
    assert np.array_equal(told[0]["affordances"], np.tile(single[0], PICTURES))
    assert np.array_equal(told[4]["affordances"], np.concatenate(single[1:]))
    assert told[4]["itself"].tolist() == [0.5, *np.eye(6, dtype=np.float32)[2].tolist()]


def test_shipped_encoders_have_cards_and_differ():
    picture = np.random.default_rng(0).integers(255, size=(3, 3, 64, 64), dtype=np.uint8)
    told = []
    for kind in (Affordances, Untrained):
        (file,) = kind.files
        card = read_card(file)
        assert (card.trainer, card.config["encoder"]) == ("affordances", kind.name)
        assert file.stat().st_size < 4e6
        told.append(FrozenEncoder(file).features(picture))
        assert ENCODERS[kind.name] is kind
    assert not np.array_equal(*told)


def test_an_encoder_without_weights_has_one_clear_error(tmp_path, monkeypatch):
    monkeypatch.setattr(affordances, "weights_of", lambda name: tmp_path / f"{name}.onnx")
    with pytest.raises(InvalidInputError, match=r"no encoder .*classification.*dohyo train affordances makes one"):
        Classification()


@pytest.mark.slow
def test_a_training_stores_encodings_and_needs_no_pictures(tmp_path):
    settings = ("env=driving-affordances", "steps=60", "processes=0", "episodes=1", "evaluate_every=60", "shown=1")
    sizes = ("iqn.hidden=[8]", "iqn.batch=4", "iqn.round_steps=20", "iqn.learning_starts=20", "checkpoint_every=60")
    config = read_settings(GriRunConfig, CONFIG, (*settings, *sizes, "tensorboard=false"))
    GRI.train(config, TrainRequest("gri", tmp_path, False, no_report))
    shown = Demonstrations(tmp_path / "demonstrations").transitions()
    assert shown["observation", "affordances"].shape[1:] == (LENGTH,)
    assert set(OnnxPolicy(tmp_path / "best.onnx").inputs) == {"affordances", "itself"}
    assert Griad(tmp_path / "best.onnx").spec.sensors == Affordances.sensors


def test_a_service_takes_the_submission_of_affordances_and_it_drives_as_the_agent(policy, tmp_path):
    file = tmp_path / "submission.onnx"
    spec = write_submission("griad", policy, file)
    agent, rng = Griad(policy), np.random.default_rng(0)
    agent.reset(Mission(start=Place(lane="a", position_m=0.0), goal=Place(lane="b", position_m=0.0)), 0)
    observations = [
        {
            **{name: rng.integers(255, size=(3, 64, 64), dtype=np.uint8) for name in CAMERAS},
            "speedometer": rng.uniform(0.0, 10.0, 2).astype(np.float32),
            "navigation": np.array([rng.integers(6), 50.0, 10.0], np.float32),
        }
        for _ in range(12)
    ]
    expected = [agent.act(observation) for observation in observations]
    assert len({tuple(row) for row in np.array(expected).tolist()}) > 1
    np.testing.assert_allclose(answers(file, observations), expected, atol=1e-6)
    assert spec.track == "sensors"
    assert "state_latents" in check_policy(file.read_bytes(), spec).states
