from __future__ import annotations

import numpy as np
import pytest

from dohyo.sumo_networks.freeway.energy import fuel_rate, fuel_rates


def test_fuel_by_hand_its_floor_and_its_cut_off() -> None:
    assert fuel_rate(20.0, 0.0) == pytest.approx(0.22498 + 0.021292 * 20 + 3.7654e-5 * 8000)
    assert fuel_rate(5.0, -3.0) == pytest.approx(0.1637)
    assert fuel_rate(20.0, -2.0) == 0.0
    by_hand = 0.22498 + 0.2129200 + 0.037654 + 0.17419 + 0.94617 + 0.071347 + 0.2884
    assert fuel_rates(np.array([10.0]), np.array([1.0]))[0] == pytest.approx(by_hand, rel=1e-4)
