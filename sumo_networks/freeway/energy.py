"""CIRCLES energy model of a mid-size SUV on a flat road: fuel rate from speed and acceleration."""

from __future__ import annotations

from numba import njit, vectorize

from dohyo.sumo_networks.arrays import FloatArray


@njit(cache=True)
def fuel_rate(v: float, a: float) -> float:
    """Fuel rate of a mid-size SUV on a flat road, g/s; v in m/s, a in m/s^2. Source: CIRCLES energy models."""
    if v > 9.16 and a <= -0.26854 - 0.0015267 * v - 0.00032843 * v * v:
        return 0.0
    positive = max(a, 0.0)
    fuel = 0.22498 + 0.021292 * v + 3.7654e-5 * v**3 + 0.17419 * a + 0.094617 * a * v + 0.00071347 * a * v * v
    return max(fuel + 0.02884 * positive * positive * v, 0.1637 if v <= 9.16 else 0.0)


@vectorize(["float64(float64, float64)"], cache=True)  # type: ignore[no-untyped-call]
def _fuel_rates(v, a):  # type: ignore[no-untyped-def]
    return fuel_rate(v, a)


def fuel_rates(speed: FloatArray, acceleration: FloatArray) -> FloatArray:
    """`fuel_rate` for arrays, g/s."""
    rates: FloatArray = _fuel_rates(speed, acceleration)
    return rates
