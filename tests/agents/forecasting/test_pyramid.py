"""The Laplacian pyramid: padding, levels by hand, perfect reconstruction, and the loss."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dohyo.agents.forecasting.pyramid import LaplacianLoss, expand, padded_length, pyramid, reconstruct


@pytest.mark.parametrize(("depth", "length"), [(0, 21), (1, 22), (2, 24), (3, 24), (4, 32)])
def test_21_segments_are_padded_to_a_multiple_of_two_to_the_depth(depth: int, length: int) -> None:
    assert padded_length(21, depth) == length
    levels = pyramid(torch.rand(2, 21), depth)
    assert [level.shape[-1] for level in levels] == [length // 2**j for j in range(depth + 1)]


def test_one_halving_of_a_single_spike_by_hand() -> None:
    spike = torch.tensor([0.0, 0.0, 0.0, 0.0, 16.0, 0.0, 0.0, 0.0])
    fine, rest = pyramid(spike, 1)
    # Blurred: 1 4 6 4 1 around the spike; every second of them is kept.
    np.testing.assert_allclose(rest, [0.0, 1.0, 6.0, 1.0])
    # Back: zeros between, the kernel 1 4 6 4 1 / 8; so 1/8 (6 a) on a kept place with 1/8 of each kept neighbour.
    inside = (1.0 * 1 + 6.0 * 6 + 1.0 * 1) / 8
    assert fine[4] == pytest.approx(16.0 - inside)
    assert fine[3] == pytest.approx(0.0 - (4 * 1.0 + 4 * 6.0) / 8)


@given(st.integers(1, 40), st.integers(0, 4), st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_the_levels_give_the_speeds_back(segments: int, depth: int, seed: int) -> None:
    speeds = torch.from_numpy(np.random.default_rng(seed).uniform(0, 30, (3, segments)))
    back = reconstruct(pyramid(speeds, depth), segments)
    np.testing.assert_allclose(back, speeds, atol=1e-9)


def test_a_constant_road_expands_to_the_same_constant() -> None:
    np.testing.assert_allclose(expand(torch.full((6,), 3.0)), np.full(12, 3.0), rtol=1e-6)


def test_depth_zero_is_the_mean_absolute_difference() -> None:
    difference = torch.tensor([[1.0, -2.0, 3.0]])
    assert float(LaplacianLoss(3, 0)(difference)) == pytest.approx(2.0)


@given(st.integers(0, 4), st.integers(0, 2**31))
@settings(max_examples=20, deadline=None)
def test_the_loss_is_the_weighted_sum_over_the_levels_of_both_pyramids(depth: int, seed: int) -> None:
    one, other = torch.from_numpy(np.random.default_rng(seed).random((2, 5, 21), dtype=np.float32))
    both = zip(pyramid(one, depth), pyramid(other, depth), strict=True)
    expected = sum(4**j * (a - b).abs().sum(-1).mean() / 21 for j, (a, b) in enumerate(both))
    assert float(LaplacianLoss(21, depth)(one - other)) == pytest.approx(float(expected), rel=1e-4)


def test_padding_counts_nothing_but_deep_pyramids_have_a_lot_of_it() -> None:
    levels = pyramid(torch.ones(21), 4)
    assert float(levels[0][23:].abs().max()) < 1.0
    assert padded_length(21, 4) - 21 == 11
