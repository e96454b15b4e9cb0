"""Savitzky-Golay derivatives: exact on polynomials, without delay, and as scipy has them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter  # type: ignore[import-untyped]

from dohyo.evaluation.scores.nuplan.smoothing import savitzky_golay
from dohyo.sumo_networks.errors import InvalidInputError


@pytest.mark.parametrize(("window", "order", "derivative"), [(7, 2, 0), (7, 2, 1), (15, 2, 1), (15, 3, 2)])
def test_as_scipy(window: int, order: int, derivative: int) -> None:
    values = np.random.default_rng(0).normal(size=60)
    expected = savgol_filter(values, window, order, deriv=derivative, delta=0.1, mode="interp")
    assert savitzky_golay(values, window, order, derivative, 0.1) == pytest.approx(expected)


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(-5, 5), st.integers(3, 40))
def test_a_parabola_is_differentiated_exactly_up_to_its_ends(a: float, b: float, c: float, count: int) -> None:
    t = 0.1 * np.arange(count)
    slope = savitzky_golay(a * t**2 + b * t + c, 7, 2, 1, 0.1)
    assert slope == pytest.approx(2 * a * t + b, abs=1e-6)


def test_no_delay() -> None:
    step = savitzky_golay(np.repeat([0.0, 1.0], 20), 7, 2, 1, 0.1)
    assert step[19] == pytest.approx(step[20])  # symmetric about the jump between both
    assert step.argmax() in (19, 20)


def test_too_few_samples_have_no_derivative() -> None:
    assert savitzky_golay(np.array([1.0, 5.0]), 7, 2, 1, 0.1).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(("window", "order", "derivative"), [(8, 2, 1), (7, 7, 1), (7, 2, 3)])
def test_windows_that_lag_or_determine_nothing_are_refused(window: int, order: int, derivative: int) -> None:
    with pytest.raises(InvalidInputError, match="odd window"):
        savitzky_golay(np.zeros(30), window, order, derivative, 0.1)
