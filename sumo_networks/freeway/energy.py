"""CIRCLES energy model of a mid-size SUV on a flat road: fuel rate from speed and acceleration."""

from __future__ import annotations

from typing import Final

from numba import njit, vectorize

from dohyo.sumo_networks.arrays import FloatArray

CUT_MPS: Final = 9.16
"""Speed above which an engine that brakes gets no fuel, m/s."""
IDLE_G_S: Final = 0.1637


@njit(cache=True)
def fuel_rate(v: float, a: float) -> float:
    """Fuel rate of a mid-size SUV of 1897 kg on a flat road, g/s; v in m/s, a in m/s^2.

    More acceleration than the vehicle has counts as what it has. Source: CIRCLES energy models, simplified model of the
    mid-size SUV, version 1.0 (2023).
    """
    v = max(v, 0.0)
    if v < 0.1 and abs(a) < 0.01:
        return IDLE_G_S
    a = min(a, 3.3377, 53.4583 / max(v, 1e-12) - 0.00023901 * v * v)
    if v > CUT_MPS and a <= -0.26854 - 0.0015267 * v - 0.00032843 * v * v:
        return 0.0
    slope, curvature = 0.17419 + 0.094617 * v + 0.00071347 * v * v, 0.02884 * v
    convex = max(a, -slope / max(2.0 * curvature, 1e-12))  # from where fuel rises with acceleration
    fuel = 0.22498 + 0.021292 * v + 3.7654e-5 * v**3 + slope * a + curvature * convex * convex
    return max(fuel, IDLE_G_S if v <= CUT_MPS else 0.0)


@vectorize(["float64(float64, float64)"], cache=True)  # type: ignore[no-untyped-call]
def _fuel_rates(v, a):  # type: ignore[no-untyped-def]
    return fuel_rate(v, a)


def fuel_rates(speed: FloatArray, acceleration: FloatArray) -> FloatArray:
    """`fuel_rate` for arrays, g/s."""
    rates: FloatArray = _fuel_rates(speed, acceleration)
    return rates
