"""Sum tree: sums, draws in proportion to weights, and equality whatever the order of writing."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.agents.learning.experience.sum_tree import SumTree


@pytest.mark.parametrize("size", [1, 2, 7, 64, 100])
def test_a_mass_finds_the_slot_in_which_it_lies(size: int) -> None:
    weights = np.random.default_rng(size).integers(0, 4, size).astype(np.float64)
    weights[size // 2] = 3.0
    tree = SumTree(size)
    tree.set(np.arange(size), weights)
    masses = np.arange(0.0, weights.sum()) + 0.5
    assert tree.total == weights.sum()
    assert tree.find(masses).tolist() == np.repeat(np.arange(size), weights.astype(int)).tolist()


def test_a_slot_without_weight_is_never_drawn() -> None:
    tree = SumTree(10)
    tree.set(np.array([2, 3, 8]), np.array([0.1, 0.2, 0.3]))
    tree.set(np.array([3]), 0.0)
    masses = np.array([0.0, np.nextafter(tree.total, 0.0), tree.total])  # rounding may give the total itself
    assert set(tree.find(masses).tolist()) <= {2, 8}


def test_equal_weights_make_an_equal_tree() -> None:
    rng = np.random.default_rng(0)
    weights = rng.random(1000)
    one, other = SumTree(1000), SumTree(1000)
    one.set(np.arange(1000), weights)
    for slots in np.array_split(rng.permutation(1000), 30):
        other.set(slots, 7.0)
        other.set(slots, weights[slots])
    masses = rng.random(5000) * one.total
    assert one.total == other.total
    assert one.find(masses).tolist() == other.find(masses).tolist()
