"""Labels of a moment: what the encoder's heads learn, of the car as it stands or as its cameras are displaced.

A moved camera sees another road: the distances fall by as much as it is ahead, and the angle turns with it.

Source: Chekroun 2024, section 4.4.2.1: road type ahead, presence and colour of the light, distance to it, rotation to
the lane. The distance from the lane's middle is that of the affordances before it (Toromanoff et al. 2020). Ours: what
counts as ahead.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.geometry import wrap_angle
from dohyo.sumo_networks.sensors import Observation
from dohyo.sumo_networks.sensors.path import BEHIND
from dohyo.sumo_networks.world import LightState

SENSORS: Final = ("path", "junctions_ahead")
JUNCTION_M, LIGHT_M = 15.0, 40.0
"""A junction is ahead from the first distance to its line on, a light from the second: there it has four pixels."""
AROUND: Final = 5
"""Points of the path around the ego among which the one nearest to the cameras is."""
COLOURS: Final = (LightState.RED, LightState.YELLOW, LightState.GREEN)


class Labels(NamedTuple):
    """What is ahead.

    Attributes:
        junction: Whether a junction is near, or around the ego; else the road is straight on.
        light: 0 for none, then red, yellow, green: the number in `COLOURS` plus 1.
        distance_m: From the front to the light's line, m; 0 without a light.
        angle_rad: From the lane's direction to the cameras', left positive, rad.
        offset_m: From the lane's middle to the cameras, left positive, m.
    """

    junction: bool
    light: int
    distance_m: float
    angle_rad: float
    offset_m: float


def labels_of(observation: Observation, displacement: FloatArray) -> Labels:
    """Labels of the pictures that displaced cameras take.

    Args:
        observation: With `SENSORS`.
        displacement: (6,) see `cameras`.
    """
    x, y, yaw = float(displacement[0]), float(displacement[1]), math.radians(float(displacement[3]))
    path = observation["path"].astype(np.float64)
    here = float(path[BEHIND, 2])
    ahead = x * math.cos(here) + y * math.sin(here)
    junctions = [(row[0] - ahead, row[1] - ahead, int(row[2])) for row in observation["junctions_ahead"].tolist()]
    light, distance = _light(junctions)
    near = any(end > 0.0 and line < JUNCTION_M for line, end, _ in junctions)
    direction, offset = _lane(path, x, y)
    return Labels(near, light, distance, float(wrap_angle(np.asarray(yaw - direction))), offset)


def _light(junctions: list[tuple[float, float, int]]) -> tuple[int, float]:
    """Colour of the light at the next line, and the distance to that line [m]."""
    line, signal = next(((line, signal) for line, _, signal in junctions if line >= 0.0), (math.inf, -1))
    if line > LIGHT_M or signal not in COLOURS:
        return 0, 0.0
    return COLOURS.index(LightState(signal)) + 1, line


def _lane(path: FloatArray, x: float, y: float) -> tuple[float, float]:
    """Direction of the lane beside a place in the ego's frame [rad], and the place's distance to the left of it [m]."""
    near = path[BEHIND - AROUND : BEHIND + AROUND + 1]
    along, aside, direction = near[np.hypot(near[:, 0] - x, near[:, 1] - y).argmin(), :3].tolist()
    return direction, (y - aside) * math.cos(direction) - (x - along) * math.sin(direction)
