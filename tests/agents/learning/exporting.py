"""Trainings that write no ONNX models, in tests of what else they do: a picture's network takes seconds to export.

with without_onnx():
    trainer.train(...)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from gymnasium.spaces import Dict
from torch import nn

from dohyo.agents.learning.policies import export

WITHOUT_ONNX = "from tests.agents.learning.exporting import replace; replace()\n"
"""The same for a process of its own: what it runs first."""


def replace() -> None:
    """Writes the facts of a policy where its ONNX model would be; its weights are written as ever."""
    export._onnx = _facts


@contextmanager
def without_onnx() -> Iterator[None]:
    """Replaces it for a while."""
    whole = export._onnx
    replace()
    try:
        yield
    finally:
        export._onnx = whole


def _facts(module: nn.Module, space: Dict, facts: Mapping[str, str]) -> bytes:
    return repr((list(space.spaces), sorted(facts.items()))).encode()
