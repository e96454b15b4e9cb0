"""The agents of RLAD and RLfOLD: by name, from a policy and its card; as an ONNX model of a service."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch

from dohyo.agents.endless_driving.agent import EndlessDriver
from dohyo.agents.endless_driving.config import TownConfig
from dohyo.agents.registry import agent_entries, resolve
from dohyo.agents.rlad.agent import Rlad
from dohyo.agents.rlfold.agent import Rlfold
from dohyo.agents.submission import write_submission
from dohyo.evaluation.agent import AgentSpec, Mission, make_agent
from dohyo.service.policies.checks import check_policy
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Place
from dohyo.sumo_networks.sensors import make_sensors
from tests.agents.endless_driving.policies import drawn_policy

MISSION = Mission(start=Place(lane="a", position_m=0.0), goal=Place(lane="b", position_m=0.0))


def seen(spec: AgentSpec, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """An observation drawn at random."""
    found = {}
    for sensor in make_sensors(spec.sensors):
        shape, dtype = sensor.space.shape, sensor.space.dtype
        found[sensor.name] = rng.integers(255, size=shape, dtype=np.uint8) if dtype == np.uint8 else rng.random(shape)
    return {name: array.astype(np.uint8 if array.dtype == np.uint8 else np.float32) for name, array in found.items()}


def answers(model: bytes | Path, observations: list[dict[str, np.ndarray]]) -> np.ndarray:
    """(N, A) actions of an ONNX model, with its states kept from tick to tick, as a service keeps them."""
    session = onnxruntime.InferenceSession(model if isinstance(model, bytes) else str(model))
    states = {one.name: np.zeros(one.shape, np.float32) for one in session.get_inputs() if "state_" in one.name}
    actions = []
    for observation in observations:
        action, *after = session.run(["action", *(f"next_{name}" for name in states)], {**observation, **states})
        states = dict(zip(states, after, strict=True))
        actions.append(action)
    return np.array(actions)


def test_an_agent_without_shipped_weights_says_what_it_needs() -> None:
    class Unshipped(EndlessDriver):
        trainer = "unshipped"

    with pytest.raises(InvalidInputError, match=r"'unshipped' has no shipped weights: expected the setting 'policy'"):
        Unshipped()


@pytest.mark.parametrize("name", ["rlad", "rlfold"])
def test_a_policy_that_is_not_there_is_named(name: str) -> None:
    with pytest.raises(InvalidInputError, match=r"no policy '/nowhere\.onnx'"):
        make_agent(resolve(name), {"policy": "/nowhere.onnx"})


@pytest.mark.parametrize(("name", "fastest"), [("rlad", 6.0), ("rlfold", 5.0)])
def test_a_shipped_policy_drives_from_a_picture(name: str, fastest: float) -> None:
    assert name in agent_entries()
    agent = make_agent(resolve(name))
    agent.reset(MISSION, 0)
    action = agent.act(seen(agent.spec, np.random.default_rng(0)))
    assert 0.0 <= action[0] <= fastest, "its training's highest speed"
    assert (agent.spec.track, "camera_64" in agent.spec.sensors) == ("map", True)


def test_an_agent_drives_as_its_card_says(tmp_path: Path) -> None:
    """Half of the range of the policy is half of the training's highest speed, whatever that is."""
    rng, driven = np.random.default_rng(0), []
    for speed in (4.0, 8.0):
        policy = drawn_policy(tmp_path / f"{speed}", TownConfig(max_speed=speed, frames=2, history=1))
        agent = make_agent(resolve("rlad"), {"policy": str(policy)})
        agent.reset(MISSION, 0)
        action = agent.act(seen(agent.spec, rng))
        assert policy.with_name("card.json") in agent.files, "records name by their hash what decides"
        told = agent.explain()
        assert told is not None
        driven.append(action[0] / (told["policy_action"][0] + 1.0))
    assert driven == pytest.approx([2.0, 4.0])
    twin = drawn_policy(tmp_path / "twin", TownConfig(view="state", frames=1), "rlfold")
    assert Rlfold(twin).spec.track == "privileged"


def test_a_policy_without_its_card_or_of_another_trainer_is_refused(tmp_path: Path) -> None:
    policy = drawn_policy(tmp_path, TownConfig())
    with pytest.raises(InvalidInputError, match="expected a policy of trainer 'rlfold', got one of 'rlad'"):
        Rlfold(policy)
    (tmp_path / "card.json").unlink()
    with pytest.raises(InvalidInputError, match=r"card\.json"):
        Rlad(policy)


def both(folder: Path, town: TownConfig) -> tuple[np.ndarray, np.ndarray]:
    """(7, 2) actions of a policy drawn by seed 0, as an agent and as its submission."""
    torch.manual_seed(0)
    policy, file = drawn_policy(folder, town), folder / "submission.onnx"
    spec = write_submission("rlad", policy, file)
    assert "state_ticks" in check_policy(file.read_bytes(), spec).states
    agent: EndlessDriver = Rlad(policy)
    agent.reset(MISSION, 0)
    rng = np.random.default_rng(0)
    observations = [seen(spec, rng) for _ in range(7)]
    return np.array([agent.act(observation) for observation in observations]), answers(file, observations)


@pytest.mark.parametrize("town", [TownConfig(), TownConfig(frames=1, history=1, max_speed=5.0)])
def test_a_service_takes_the_submission_and_it_drives_as_the_agent(tmp_path: Path, town: TownConfig) -> None:
    driven, submitted = both(tmp_path, town)
    assert len({tuple(row) for row in driven.tolist()}) == 4  # a decision for two ticks
    np.testing.assert_allclose(submitted, driven, atol=1e-5)


def test_agent_and_submission_stand_below_the_same_target_speed(tmp_path: Path) -> None:
    creeping, _ = both(tmp_path / "creeping", TownConfig(max_speed=2.5))
    middle = float(np.unique(creeping[:, 0])[1:3].mean())
    standing, submitted = both(tmp_path / "standing", TownConfig(max_speed=2.5, stand_below=middle))
    expected = np.where(creeping[:, :1] < middle, np.array([0.0, 1.0]), np.array([1.0, 1.0])) * creeping
    assert 0 < np.count_nonzero(standing[:, 0]) < 7
    np.testing.assert_allclose(standing, expected)
    np.testing.assert_allclose(submitted, expected, atol=1e-5)


def test_the_twins_state_is_no_sensor(tmp_path: Path) -> None:
    policy = drawn_policy(tmp_path, TownConfig(view="state", frames=1))
    with pytest.raises(InvalidInputError, match="expected a policy of pictures"):
        write_submission("rlad", policy, tmp_path / "submission.onnx")
