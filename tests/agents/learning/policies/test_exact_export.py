"""Policies that answer alike on every processor: doubles inside, rounded outside, and the same numbers elsewhere."""

from __future__ import annotations

import numpy as np
import onnxruntime
import pytest
import torch
from gymnasium.spaces import Box, Dict
from torch import nn

from dohyo.agents.learning.policies.exact_export import ExactPolicy, export_exact
from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.perception.encoders.base import as_float

SPACE = Dict({"camera": Box(0, 255, (3, 20, 17), np.uint8), "speed": Box(-9.0, 9.0, (8,), np.float32)})


class Seeing(nn.Module):
    """Convolutions with all that ours have: strides, padding, a missing bias, one dimension."""

    def __init__(self) -> None:
        super().__init__()
        self.tall = nn.Conv2d(3, 5, (4, 3), stride=(2, 3), padding=(1, 2))
        self.plain = nn.Conv2d(5, 4, 2, bias=False)
        self.line = nn.Conv1d(1, 3, 3, stride=2)
        self.head = nn.Linear(4 * 9 * 6 + 9, 2)

    def forward(self, observation):
        maps = torch.relu(self.plain(torch.relu(self.tall(as_float(observation["camera"])))))
        line = self.line(observation["speed"][:, None]).flatten(1)
        return torch.tanh(self.head(torch.cat([maps.flatten(1), line], dim=-1)))

    def facts(self):
        return {}


def observations(count):
    rng = np.random.default_rng(4)
    return {
        "camera": rng.integers(0, 256, (count, 3, 20, 17), dtype=np.uint8),
        "speed": rng.normal(size=(count, 8)).astype(np.float32),
    }


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    torch.manual_seed(2)
    policy, path = Seeing(), tmp_path_factory.mktemp("exact") / "best"
    export_exact(policy, SPACE, path, {})
    return policy, path.with_suffix(".onnx")


def test_it_is_the_policy_to_five_decimals(exported):
    policy, path = exported
    seen = observations(50)
    with torch.no_grad():
        own = policy({name: torch.from_numpy(array) for name, array in seen.items()}).numpy()
    assert OnnxPolicy(path).of_batch(seen) == pytest.approx(own, abs=1e-5)


def test_torch_and_onnx_runtime_and_any_batch_give_the_same_bits(exported):
    """Their kernels add in other orders, as those of two processors do."""
    policy, path = exported
    seen = observations(200)
    slow = onnxruntime.SessionOptions()
    slow.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    plain = onnxruntime.InferenceSession(path, slow).run(None, seen)[0]
    fast = OnnxPolicy(path)
    with torch.no_grad():
        ours = ExactPolicy(policy)({name: torch.from_numpy(array) for name, array in seen.items()}).numpy()
    single = [fast({name: array[row] for name, array in seen.items()}) for row in range(200)]
    assert np.array_equal(plain, ours)
    assert np.array_equal(plain, np.stack(single))
