"""Shortest curve between two poses, forwards only or also in reverse."""

from __future__ import annotations

from numba import njit

from dohyo.agents.parking.expert.curves import relative_to
from dohyo.agents.parking.expert.dubins import dubins
from dohyo.agents.parking.expert.reeds_shepp import reeds_shepp
from dohyo.sumo_networks.arrays import FloatArray


@njit(cache=True)
def shortest_curve(start: FloatArray, goal: FloatArray, radius: float, reverse: bool) -> tuple[float, FloatArray]:
    """Shortest curve between two poses.

    Args:
        start: (3,) x, y [m] and heading [rad].
        goal: (3,) likewise.
        radius: Turning radius, m.
        reverse: Whether the curve may drive in reverse.

    Returns:
        Length [m], and the curve, see `curves`.
    """
    x, y, heading = relative_to(start, goal, radius)
    length, curve = reeds_shepp(x, y, heading) if reverse else dubins(x, y, heading)
    return length * radius, curve
