"""Policies that answer alike on every processor: doubles inside, rounded outside, and the same numbers elsewhere."""

from __future__ import annotations

import numpy as np
import onnxruntime
import pytest
import torch
from gymnasium.spaces import Box, Dict, Discrete
from safetensors import safe_open
from torch import nn

from dohyo.agents.learning.networks.vectors import ActionVector
from dohyo.agents.learning.policies.exact_export import ExactPolicy, decimals, export_exact, export_running
from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.perception.encoders.base import as_float

ACTIONS = Box(-1.0, 1.0, (2,), np.float32)
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
    export_exact(policy, (SPACE, ACTIONS), path, {})
    return policy, path.with_suffix(".onnx")


def test_it_is_the_policy_to_five_decimals(exported):
    policy, path = exported
    seen = observations(50)
    with torch.no_grad():
        own = policy({name: torch.from_numpy(array) for name, array in seen.items()}).numpy()
    assert OnnxPolicy(path).of_batch(seen) == pytest.approx(own, abs=1e-5)


class Behind(nn.Module):
    """What follows some layers that see the camera."""

    def __init__(self, layers):
        super().__init__()
        self.layers = layers

    def forward(self, observation):
        return torch.tanh(self.layers(as_float(observation["camera"])).flatten(1)[:, :2])

    def facts(self):
        return {}


LAYERS = {
    "normalised over a map": nn.Sequential(nn.Conv2d(3, 4, 3), nn.LayerNorm([4, 18, 15])),
    "normalised over a line": nn.LayerNorm(17),
    "normalised without weights": nn.LayerNorm([20, 17], elementwise_affine=False),
    "normalised without bias": nn.LayerNorm(17, bias=False),
    "replicated": nn.Conv2d(3, 2, 3, padding=1, padding_mode="replicate"),
    "reflected": nn.Conv2d(3, 2, 3, padding=(2, 1), padding_mode="reflect"),
    "same": nn.Conv2d(3, 2, 4, padding="same"),
    "valid": nn.Conv2d(3, 2, 4, padding="valid"),
    "dilated": nn.Conv2d(3, 2, (3, 2), stride=2, padding="valid", dilation=(2, 3)),
    "dilated and the same": nn.Conv2d(3, 2, (2, 3), padding="same", dilation=(3, 2)),
    "grouped": nn.Conv2d(3, 6, 3, stride=2, padding=1, groups=3),
}


@pytest.mark.parametrize("name", LAYERS)
def test_layers_of_every_kind_are_exported_as_they_are(name, tmp_path):
    policy, seen = Behind(LAYERS[name]), observations(20)
    for parameter in policy.parameters():
        torch.nn.init.uniform_(parameter, -0.5, 0.5, generator=torch.Generator().manual_seed(7))
    export_exact(policy, (SPACE, ACTIONS), tmp_path / "policy", {})
    with torch.no_grad():
        own = policy({name: torch.from_numpy(array) for name, array in seen.items()}).numpy()
    assert np.ptp(own) > 0.05
    assert OnnxPolicy(tmp_path / "policy.onnx").of_batch(seen) == pytest.approx(own, abs=2e-5)


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


class Reaching(nn.Module):
    """The unit vector that it sees, in an action space, as the policies of SAC and DDPG end."""

    def __init__(self, actions):
        super().__init__()
        self.space = ActionVector(actions)

    def forward(self, observation):
        return self.space.inverse(observation["unit"])

    def facts(self):
        return {}


def through_a_file(actions, unit, folder):
    """Actions of `Reaching` at (N, A) unit vectors, from its ONNX model."""
    spaces = Dict({"unit": Box(-1.0, 1.0, actions.shape, np.float32)}), actions
    export_exact(Reaching(actions), spaces, folder / "policy", {})
    return OnnxPolicy(folder / "policy.onnx").of_batch({"unit": unit})


@pytest.mark.parametrize("bound", [2e-5, 3e-12, 0.3, np.pi / 4, 1.0, 40.0])
def test_a_space_of_any_width_keeps_its_bounds_and_a_hundred_thousand_actions(bound, tmp_path):
    """Pi / 4 is 0.7853982, and 0.7854 to five decimals."""
    actions = Box(-bound, bound, (1,), np.float32)
    unit = np.linspace(-1.0, 1.0, 2001, dtype=np.float32)[:, None]
    got = through_a_file(actions, unit, tmp_path)
    assert all(map(actions.contains, got))
    assert got == pytest.approx(bound * unit, abs=1.01e-5 * bound, rel=0)
    assert got.max() == actions.high.item()
    assert len(np.unique(got)) == len(unit)


def test_every_number_of_an_action_has_the_decimals_of_its_own_width():
    low, high = np.array([0.0, -1.0, -2e-5, 5.0], np.float32), np.array([1.0, 1.0, 2e-5, 95.0], np.float32)
    assert decimals(Box(low, high)).tolist() == [5, 5, 10, 5]


def test_actions_of_ordinary_width_are_rounded_to_five_decimals_and_no_bit_else(tmp_path):
    actions = Box(np.array([0.0, -1.0, -2.0], np.float32), np.array([1.0, 1.0, 2.0], np.float32))
    unit = np.random.default_rng(1).uniform(-1.2, 1.2, (5000, 3)).astype(np.float32)
    with torch.no_grad():
        whole = Reaching(actions).double()({"unit": torch.from_numpy(unit).double()})
    assert np.array_equal(through_a_file(actions, unit, tmp_path), (torch.round(whole * 1e5) / 1e5).float().numpy())


def test_what_is_no_action_of_the_space_has_five_decimals_and_no_bounds(tmp_path):
    """A master answers with the values of all its options."""
    spaces = Dict({"unit": Box(-9.0, 9.0, (4,), np.float32)}), Box(-1e-3, 1e-3, (3,), np.float32)
    export_exact(Plain(), spaces, tmp_path / "policy", {})
    unit = np.array([[0.123456, -7.0, 3.0, 0.0]], np.float32)
    got = OnnxPolicy(tmp_path / "policy.onnx").of_batch({"unit": unit})
    assert np.array_equal(got, np.array([[0.24691, -14.0, 6.0, 0.0]], np.float32))


class Plain(nn.Module):
    def forward(self, observation):
        return 2.0 * observation["unit"]

    def facts(self):
        return {}


def test_the_same_policy_gives_the_same_bytes(exported, tmp_path):
    """safetensors alone writes facts in an order that it draws anew for every file."""
    policy, _ = exported
    for name in ("one", "other"):
        export_exact(policy, (SPACE, ACTIONS), tmp_path / name, {name: f"«{name}»" for name in "hgfedcba"})
    for kind in ("onnx", "safetensors"):
        assert tmp_path.joinpath(f"one.{kind}").read_bytes() == tmp_path.joinpath(f"other.{kind}").read_bytes()


def test_ordered_files_are_those_of_the_library_in_another_order(tmp_path):
    """Weights of all types, without values, of odd sizes; the numbers stay at a multiple of eight bytes."""
    policy = Kinds()
    export_running(policy, policy, Dict({"unit": Box(-1.0, 1.0, (2,), np.float32)}), tmp_path / "policy", {"é": "ü"})
    with safe_open(tmp_path / "policy.safetensors", "pt") as file:
        assert file.metadata() == {"é": "ü"}
        assert {name: file.get_tensor(name).tolist() for name in file.keys()} == {  # noqa: SIM118 - no mapping
            name: one.tolist() for name, one in policy.state_dict().items()
        }
    assert int.from_bytes((tmp_path / "policy.safetensors").read_bytes()[:8], "little") % 8 == 0


def test_discrete_policies_are_exported_alike_too(tmp_path):
    spaces, facts = (Dict({"unit": Box(-1.0, 1.0, (3,), np.float32)}), Discrete(3)), dict.fromkeys("hgfedcba", "")
    files = []
    for _ in range(2):
        export_exact(Best(), spaces, tmp_path / "policy", facts)
        files.append((tmp_path / "policy.safetensors").read_bytes())
    assert files[0] == files[1]
    assert OnnxPolicy(tmp_path / "policy.onnx")({"unit": np.array([0.1, 0.7, 0.2], np.float32)}) == 1


class Kinds(Plain):
    def __init__(self):
        super().__init__()
        self.register_buffer("Flags", torch.tensor([True, False, True]))
        self.register_buffer("small", torch.arange(5, dtype=torch.uint8))
        self.register_buffer("none", torch.zeros(0, 3))
        self.register_buffer("halves", torch.ones(3, dtype=torch.float16))
        self.register_buffer("wide", torch.full((), 0.1, dtype=torch.float64))


class Best(Plain):
    def forward(self, observation):
        return observation["unit"].argmax(dim=-1)
