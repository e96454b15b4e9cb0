"""Policies in double precision, rounded: the last digits of single precision depend on the processor's kernels.

A drive repeats every deviation of an action, so that records made in single precision verify on one kind of machine
only.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Final

import numpy as np
import torch
from torch import nn

from dohyo.sumo_networks.arrays import Float32Array

DECIMALS: Final = 5
"""Two processors differ after the twelfth."""


def exact(module: nn.Module) -> Callable[[Float32Array], Float32Array]:
    """A network of vectors as a function of one: (O,) -> (A,), with numbers that are the same on every processor."""
    double = deepcopy(module).double().eval()

    @torch.no_grad()
    def answer(vector: Float32Array) -> Float32Array:
        numbers = double(torch.from_numpy(vector).double()[None])[0].numpy()
        return np.asarray(numbers.round(DECIMALS), dtype=np.float32)

    return answer
