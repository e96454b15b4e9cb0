"""SUMO's frame: angles in degrees clockwise from north, and a vehicle's position at the middle of its front bumper."""

from __future__ import annotations

import math

import libsumo
from numba.extending import register_jitable

Box = tuple[float, float, float, float, float]
"""x, y of the centre [m], heading [rad], length, width [m], in the network frame."""


@register_jitable
def heading_of(angle: float) -> float:
    """Heading [rad, counter-clockwise from +x, in [-pi, pi)] of a SUMO angle [degrees]."""
    return (1.5 * math.pi - math.radians(angle)) % (2 * math.pi) - math.pi


def angle_of(heading: float) -> float:
    """SUMO angle [degrees] of a heading [rad]."""
    return 90.0 - math.degrees(heading)


@register_jitable
def ahead_of(x: float, y: float, heading: float, metres: float) -> tuple[float, float]:
    """Point ahead of x, y by a distance [m]; half the length leads from a centre to the front."""
    return x + metres * math.cos(heading), y + metres * math.sin(heading)


def vehicle_box(name: str) -> Box:
    """Reads the box of a vehicle from SUMO."""
    heading, length = heading_of(libsumo.vehicle.getAngle(name)), libsumo.vehicle.getLength(name)
    front_x, front_y = libsumo.vehicle.getPosition(name)
    x, y = ahead_of(front_x, front_y, heading, -0.5 * length)
    return x, y, heading, length, libsumo.vehicle.getWidth(name)
