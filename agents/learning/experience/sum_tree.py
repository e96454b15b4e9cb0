"""Sum tree: draws slots in proportion to their weights, in logarithmic time.

TorchRL's own are in a compiled extension that needs the version of torch it was built with.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import FloatArray, IntArray


class SumTree:
    """Weights of numbered slots. Equal weights make an equal tree, in whatever order they were set."""

    def __init__(self, size: int) -> None:
        """All weights are 0.

        Args:
            size: Number of slots.
        """
        self._leaves = 1 << max(size - 1, 1).bit_length()
        self._nodes = np.zeros(2 * self._leaves)  # node n has the children 2n and 2n + 1; 1 is the root

    @property
    def total(self) -> float:
        """Sum of the weights."""
        return float(self._nodes[1])

    def weights(self, slots: IntArray) -> FloatArray:
        """(B,) weights of slots."""
        return self._nodes[self._leaves + slots]

    def set(self, slots: IntArray, weights: FloatArray | float) -> None:
        """Sets the weights of (B,) slots, at least 0."""
        _set(self._nodes, self._leaves + slots, np.broadcast_to(np.asarray(weights, np.float64), slots.shape))

    def find(self, masses: FloatArray) -> IntArray:
        """(B,) masses in [0, total) -> (B,) slots, as of all weights laid end to end; never one without weight."""
        return _find(self._nodes, masses)


@njit(cache=True)
def _set(nodes: FloatArray, leaves: IntArray, weights: FloatArray) -> None:
    for index in range(len(leaves)):
        node = leaves[index]
        nodes[node] = weights[index]
        while node > 1:
            node //= 2
            nodes[node] = nodes[2 * node] + nodes[2 * node + 1]


@njit(cache=True)
def _find(nodes: FloatArray, masses: FloatArray) -> IntArray:
    first = len(nodes) // 2
    slots = np.empty(len(masses), np.int64)
    for index in range(len(masses)):
        mass, node = masses[index], 1
        while node < first:
            node *= 2
            # Rounding may leave a mass beyond the left child's although the right one is empty.
            if mass >= nodes[node] and nodes[node + 1] > 0.0:
                mass -= nodes[node]
                node += 1
        slots[index] = node - first
    return slots
