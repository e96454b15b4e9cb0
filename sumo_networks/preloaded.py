"""Imported by the server that worker processes are forked from: what each would spend a second on.

The environments import SUMO, gymnasium and shapely; numba loads its library at the first kernel.
"""

from __future__ import annotations

from numba import njit

import dohyo.sumo_networks.envs.driving_env  # noqa: F401


@njit(cache=True)
def _first_kernel(number: float) -> float:
    return number


_first_kernel(0.0)
