from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.sumo_networks.freeway.energy import fuel_rate, fuel_rates


def test_fuel_by_hand_its_floor_and_its_cut_off() -> None:
    assert fuel_rate(20.0, 0.0) == pytest.approx(0.22498 + 0.021292 * 20 + 3.7654e-5 * 8000)
    assert fuel_rate(5.0, -3.0) == pytest.approx(0.1637)
    assert fuel_rate(20.0, -2.0) == 0.0
    by_hand = 0.22498 + 0.2129200 + 0.037654 + 0.17419 + 0.94617 + 0.071347 + 0.2884
    assert fuel_rates(np.array([10.0]), np.array([1.0]))[0] == pytest.approx(by_hand, rel=1e-4)


def test_gentle_braking_and_idling_and_what_no_engine_can() -> None:
    """By hand, from the published coefficients."""
    gentle = 0.22498 + 0.42584 + 0.301232 - 0.3 * (0.17419 + 1.89234 + 0.285388) + 0.02884 * 0.09 * 20
    assert fuel_rate(20.0, -0.3) == pytest.approx(gentle)
    assert fuel_rate(0.0, 0.0) == 0.1637
    assert fuel_rate(0.0, 0.5) == pytest.approx(0.22498 + 0.17419 * 0.5)
    assert fuel_rate(-1.0, 0.0) == fuel_rate(0.0, 0.0)
    most = 53.4583 / 30 - 0.00023901 * 900
    assert fuel_rate(30.0, 3.0) == pytest.approx(fuel_rate(30.0, most))


@given(st.floats(0.1, 45.0), st.floats(-8.0, 5.0), st.floats(0.0, 1.0))
def test_fuel_never_falls_with_acceleration(v: float, a: float, more: float) -> None:
    assert fuel_rate(v, a + more) >= fuel_rate(v, a) - 1e-9
