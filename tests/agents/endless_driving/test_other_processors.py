"""The shipped policies of RLAD and RLfOLD answer alike with ONNX Runtime's kernels and numpy's, new and old."""

from __future__ import annotations

from tests.agents.old_processor import printed_here_and_there

PROGRAM = """
import numpy as np
import onnx
import torch
from onnx.reference import ReferenceEvaluator

from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import make_agent

for name in ("rlad", "rlfold"):
    path = next(file for file in make_agent(resolve(name), {}).files if str(file).endswith(".onnx"))
    policy, rng = OnnxPolicy(path), np.random.default_rng(3)
    seen = {
        one: rng.integers(0, 256, (20, *shape), dtype=dtype) if dtype == np.uint8
        else rng.normal(size=(20, *shape)).astype(dtype)
        for one, (shape, dtype) in policy.inputs.items()
    }
    print(policy.of_batch(seen).tolist())
    # Numpy's products in place of ONNX Runtime's.
    print(ReferenceEvaluator(onnx.load(path)).run(["action"], seen)[0].tolist())
    w = torch.randn(256, 304, generator=torch.Generator().manual_seed(0))
    print((w @ torch.randn(304, 64, generator=torch.Generator().manual_seed(1))).sum().item())
"""


def test_shipped_policies_of_pictures_answer_alike() -> None:
    here, old = printed_here_and_there(PROGRAM)
    told = [here[0], here[1], old[0], old[1], here[3], here[4], old[3], old[4]]
    assert len({*told[:4]}) == 1
    assert len({*told[4:]}) == 1
    assert here[2] != old[2], "single precision must differ, or nothing is tested"
