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
from tests.agents.old_processor import printed_here_and_there


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


PROGRAM = """
import numpy as np, torch
from dohyo.agents.priboot.fixed_point import ExactPriboot
from dohyo.agents.priboot.network import Priboot
torch.set_num_threads(1)
torch.manual_seed(2)
network = Priboot().eval()
rng = np.random.default_rng(4)
seen = {
    "picture": torch.from_numpy(rng.integers(0, 256, (20, 3, 160, 128), dtype=np.uint8)),
    "measurements": torch.from_numpy(rng.normal(size=(20, 11)).astype(np.float32)),
}
with torch.no_grad():
    for one in (ExactPriboot(network), network):
        print(one(seen).numpy().tobytes().hex())
"""


def test_kernels_of_another_processor_give_the_same_bits():
    """Those of the network in single precision differ."""
    (here, loose_here), (old, loose_old) = printed_here_and_there(PROGRAM)
    assert loose_here != loose_old
    assert here == old


def test_a_channel_without_weights_stays_zero():
    layer = Convolution(4, 3, 1, linear=True).eval()
    torch.nn.init.zeros_(layer.convolution.weight)
    assert not FixedPointConvolution(layer, (7, 6.0), 5)(torch.full((1, 4, 2, 2), 700.0)).any()


@pytest.mark.parametrize(("given", "low"), [((7, 6.0), 0), ((5, 128.0), -4096)])
def test_the_order_of_channels_changes_no_bit(given, low):
    """With weights that are not rounded it does; the numbers go up to the largest that a layer may read."""
    torch.manual_seed(3)
    layer = Convolution(672, 16, 1, linear=True).eval()
    fixed = FixedPointConvolution(layer, given, 5)
    maps = torch.randint(low, int(given[1] * 2 ** given[0]) + 1, (1, 672, 4, 4)).float()
    order = torch.randperm(672)
    plain = torch.nn.functional.conv2d(maps, fixed.weight, fixed.bias)
    turned = torch.nn.functional.conv2d(maps[:, order], fixed.weight[:, order], fixed.bias)
    exact = torch.nn.functional.conv2d(maps.double(), fixed.weight.double(), fixed.bias.double())
    plain_weight = layer.convolution.weight
    loose = torch.nn.functional.conv2d(maps, plain_weight)
    assert not torch.equal(loose, torch.nn.functional.conv2d(maps[:, order], plain_weight[:, order]))
    assert torch.equal(plain, turned)
    assert torch.equal(plain.double(), exact)
