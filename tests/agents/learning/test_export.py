"""Export: both files act as the actor does, and say where they come from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from safetensors import safe_open
from safetensors.torch import save_file

from dohyo.agents.learning.export import export
from dohyo.agents.learning.policy import Actor
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
    export(actor, (5,), folder / "policy", FACTS)
    return folder


def test_onnx_and_torch_agree(actor, exported):
    session = onnxruntime.InferenceSession(exported / "policy.onnx")
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
