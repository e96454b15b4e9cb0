"""A calibration kernel: how fast this machine is at the moment, so that milliseconds of two machines can be compared.

It is a loop of the interpreter and a sort of numpy's, about half of the time each: what a decision is made of.
"""

from __future__ import annotations

import time

import numpy as np

ROUNDS = 31
LOOPS, VALUES = 40_000, 40_000


def kernel(values: np.ndarray) -> float:
    """The work itself."""
    total = 0
    for i in range(LOOPS):
        total += i * i % 7
    return float(np.sort(values)[total % VALUES])


def kernel_ms() -> float:
    """Median over rounds, ms."""
    values = np.random.default_rng(0).random(VALUES)
    kernel(values)
    rounds = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        kernel(values)
        rounds.append(1e3 * (time.perf_counter() - began))
    return float(np.median(rounds))
