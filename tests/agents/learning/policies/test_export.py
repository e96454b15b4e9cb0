"""Export: both files act as the actor does, and say where they come from."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from gymnasium.spaces import Box, Dict
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from safetensors import safe_open
from safetensors.torch import save_file
from torch import nn

from dohyo.agents.learning.networks.policy import Actor
from dohyo.agents.learning.policies.export import export
from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.sumo_networks.errors import InvalidInputError

LOW, HIGH = torch.tensor([-8.0, -0.5]), torch.tensor([4.0, 0.5])
FACTS = {"steps": "12", "device": "cpu", "tier": "3"}


@pytest.fixture(scope="module")
def actor() -> Actor:
    torch.manual_seed(3)
    actor = Actor(5, LOW, HIGH, (16, 8))
    with torch.no_grad():
        actor.body[-1].weight.mul_(300.0)  # so that bounds are met
    return actor


@pytest.fixture(scope="module")
def exported(actor, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("export")
    export(actor, Dict(observation=Box(-np.inf, np.inf, (5,))), folder / "policy", FACTS)
    return folder


def test_onnx_and_torch_agree(actor, exported):
    session = onnxruntime.InferenceSession(exported / "policy.onnx")
    assert [one.name for one in (*session.get_inputs(), *session.get_outputs())] == ["observation", "action"]
    for size in (1, 2, 700):
        batch = np.random.default_rng(size).normal(size=(size, 5)).astype(np.float32) * 3
        with torch.no_grad():
            expected = actor(torch.from_numpy(batch)).numpy()
        (action,) = session.run(None, {"observation": batch})
        assert action.dtype == np.float32
        assert action == pytest.approx(expected, abs=1e-5)
    assert (expected == LOW.numpy()).any()
    assert (expected == HIGH.numpy()).any()
    assert len(np.unique(expected)) > 100


def test_both_files_tell_their_origin(exported):
    model = onnx.load(exported / "policy.onnx")
    assert FACTS.items() <= {entry.key: entry.value for entry in model.metadata_props}.items()
    with safe_open(exported / "policy.safetensors", "pt") as file:
        assert FACTS.items() <= file.metadata().items()


def test_the_same_policy_gives_the_same_bytes(actor, tmp_path):
    space = Dict(observation=Box(-np.inf, np.inf, (5,)))
    for name in ("one", "other"):
        export(actor, space, tmp_path / name, dict.fromkeys("hgfedcba", ""))
    assert (tmp_path / "one.safetensors").read_bytes() == (tmp_path / "other.safetensors").read_bytes()


def test_a_policy_whose_actions_are_no_numbers_is_refused(actor, tmp_path):
    broken = copy.deepcopy(actor)
    with torch.no_grad():
        broken.body[-1].bias.fill_(math.nan)
    for name, policy in (("whole", actor), ("broken", broken)):
        export(policy, Dict(observation=Box(-np.inf, np.inf, (5,))), tmp_path / name, FACTS)
    OnnxPolicy(tmp_path / "whole.onnx").check_actions(Box(LOW.numpy(), HIGH.numpy()))
    with pytest.raises(InvalidInputError, match=r"policy '.*broken\.onnx': expected finite actions, got \[nan, nan\]"):
        OnnxPolicy(tmp_path / "broken.onnx").check_actions(Box(LOW.numpy(), HIGH.numpy()))


def test_an_observation_cannot_have_the_name_of_the_output(actor, tmp_path):
    with pytest.raises(InvalidInputError, match=r"policy '.*policy': expected no observation named as its output"):
        export(actor, Dict(action=Box(-np.inf, np.inf, (5,))), tmp_path / "policy", FACTS)
    assert not list(tmp_path.iterdir())


def test_a_saved_actor_acts_the_same(actor, exported):
    loaded, observation = Actor.load(exported / "policy.safetensors"), np.linspace(-1, 1, 5, dtype=np.float32)
    assert (loaded.act(observation) == actor.act(observation)).all()
    assert loaded.sizes == (5, 16, 8, 2)


@given(arrays(np.float32, (2,), elements=st.floats(-1, 1, width=32)))
def test_scaling_goes_there_and_back(unit):
    actor = Actor(1, LOW, HIGH, (4,))
    action = actor.scaled(torch.from_numpy(unit))
    assert (action >= LOW).all()
    assert (action <= HIGH).all()
    assert actor.unscaled(action).numpy() == pytest.approx(unit, abs=1e-5)


def test_what_is_no_actor_is_refused(tmp_path):
    with pytest.raises(InvalidInputError, match=r"no actor '.*none"):
        Actor.load(tmp_path / "none.safetensors")
    save_file({"x": torch.zeros(2)}, tmp_path / "other.safetensors")
    with pytest.raises(InvalidInputError, match=r"other.safetensors' is no actor"):
        Actor.load(tmp_path / "other.safetensors")
    (tmp_path / "torn.safetensors").write_bytes(b"\x09")
    with pytest.raises(InvalidInputError, match="is no actor"):
        Actor.load(tmp_path / "torn.safetensors")


class Seeing(nn.Module):
    """Chooses one of three actions by a picture and a vector; ignores what else is observed."""

    def __init__(self) -> None:
        super().__init__()
        self.camera = nn.Sequential(nn.Conv2d(3, 4, 3, 2), nn.ReLU(), nn.Flatten(), nn.LazyLinear(5))
        self.head = nn.Linear(5 + 2, 3)

    def forward(self, observation: Mapping[str, torch.Tensor]) -> torch.Tensor:
        seen = self.camera(observation["camera"].float() / 255.0)
        return self.head(torch.cat([seen, observation["speed"]], dim=-1)).argmax(dim=-1)

    def facts(self) -> Mapping[str, str]:
        return {}


def test_a_model_has_an_input_for_every_observation_that_the_policy_uses(tmp_path):
    space = Dict(
        camera=Box(0, 255, (3, 16, 20), np.uint8), critics=Box(-1.0, 1.0, (4,)), speed=Box(-np.inf, np.inf, (2,))
    )
    torch.manual_seed(0)
    policy = Seeing()
    policy({name: torch.from_numpy(space[name].sample())[None] for name in space})
    export(policy, space, tmp_path / "policy", FACTS)
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx")
    types = {one.name: one.type for one in session.get_inputs()}
    assert types == {"camera": "tensor(uint8)", "speed": "tensor(float)"}
    for size in (1, 64):
        batch = {name: np.stack([space[name].sample() for _ in range(size)]) for name in space}
        (action,) = session.run(["action"], {name: batch[name] for name in types})
        with torch.no_grad():
            expected = policy({name: torch.from_numpy(values) for name, values in batch.items()}).numpy()
        assert (action.dtype, action.shape) == (np.int64, (size,))
        assert (action == expected).all()
    assert len(set(action)) > 1
