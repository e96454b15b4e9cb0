"""PRIBOOT as it is exported: the waypoints of its weights, and the same bits in any order of adding."""

from __future__ import annotations

import numpy as np
import onnxruntime
import pytest
import torch

from dohyo.agents.learning.policies.exact_export import export_running
from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.perception.encoders.efficientnet import Convolution
from dohyo.agents.priboot.fixed_point import ExactPriboot, FixedPointConvolution
from dohyo.agents.priboot.network import Priboot


def observations(count):
    rng = np.random.default_rng(4)
    patches = rng.integers(0, 256, (count, 3, 20, 16), dtype=np.uint8)
    return {
        "picture": patches.repeat(8, axis=2).repeat(8, axis=3),
        "measurements": rng.normal(size=(count, 11)).astype(np.float32),
    }


@pytest.fixture(scope="module")
def networks():
    torch.manual_seed(2)
    network = Priboot().eval()
    return network, ExactPriboot(network)


def answers(network, seen):
    with torch.no_grad():
        return network({name: torch.from_numpy(array) for name, array in seen.items()}).numpy()


def test_it_is_the_network_to_centimetres(networks):
    network, exact = networks
    seen = observations(40)
    assert np.abs(answers(exact, seen) - answers(network, seen)).mean() < 0.01


def test_torch_and_onnx_runtime_and_any_batch_give_the_same_bits(networks, tmp_path):
    network, exact = networks
    export_running(network, exact, network.space(), tmp_path / "priboot", {})
    seen = observations(40)
    slow = onnxruntime.SessionOptions()
    slow.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    plain = onnxruntime.InferenceSession(tmp_path / "priboot.onnx", slow).run(None, seen)[0]
    fast = OnnxPolicy(tmp_path / "priboot.onnx")
    single = [fast({name: array[row] for name, array in seen.items()}) for row in range(40)]
    assert np.array_equal(plain, answers(exact, seen))
    assert np.array_equal(plain, np.stack(single))


@pytest.mark.parametrize(("given", "low"), [((7, 6.0), 0), ((5, 128.0), -4096)])
def test_the_order_of_channels_and_their_grouping_change_no_bit(given, low):
    """In single precision both would; the numbers are the largest that a layer may read."""
    torch.manual_seed(3)
    layer = Convolution(672, 16, 1, linear=True).eval()
    fixed = FixedPointConvolution(layer, given, 5)
    maps = torch.randint(low, int(given[1] * 2 ** given[0]) + 1, (1, 672, 4, 4)).float()
    order = torch.randperm(672)
    plain = torch.nn.functional.conv2d(maps, fixed.weight, fixed.bias)
    turned = torch.nn.functional.conv2d(maps[:, order], fixed.weight[:, order], fixed.bias)
    exact = torch.nn.functional.conv2d(maps.double(), fixed.weight.double(), fixed.bias.double())
    assert torch.equal(plain, turned)
    assert torch.equal(plain.double(), exact)
