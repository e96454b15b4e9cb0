"""Imported by the server that worker processes are forked from: numba loads its library at the first kernel."""

from __future__ import annotations

from numba import njit


@njit(cache=True)
def _first_kernel(number: float) -> float:
    return number


_first_kernel(0.0)
