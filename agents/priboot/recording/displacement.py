"""Displacement: the world as it would look if one ego stood elsewhere.

A learner that only sees the middle of the lane never learns to come back to it. Thesis B shifts and turns the ego in
the view, and its waypoints with it. Here the view is drawn anew from the displaced pose, so that it is exact.

Source: Coelho 2024, section 5.3 (augmentation, after LBC); sizes are those of its code, whose units are not stated: we
read the angle in degrees and the others in metres, and shorten the first from 5 to 0.5.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.world import World

AHEAD_M, ASIDE_M, TURN_RAD = 0.5, 1.0, math.radians(10.0)
"""Largest displacement."""
MOVING_M_S = 0.5
"""Slower egos are not displaced: a car that stands cannot come back."""


def drawn_displacement(rng: np.random.Generator) -> FloatArray:
    """(3,) ahead, to the left [m] and turn [rad], each uniform within its bounds."""
    return np.asarray(rng.uniform(-1.0, 1.0, 3) * (AHEAD_M, ASIDE_M, TURN_RAD))


def displaced(world: World, ego: int, by: FloatArray) -> World:
    """The world with one ego displaced in its own frame; all else stays."""
    position, heading = world.egos.position.copy(), world.egos.heading.copy()
    cos, sin = math.cos(heading[ego]), math.sin(heading[ego])
    position[ego] += (by[0] * cos - by[1] * sin, by[0] * sin + by[1] * cos)
    heading[ego] += by[2]
    return dataclasses.replace(world, egos=dataclasses.replace(world.egos, position=position, heading=heading))
