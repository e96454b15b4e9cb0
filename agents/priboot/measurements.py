"""Measurements: what PRIBOOT reads beside the picture, (11,) float32.

Columns: speed and speed limit [10 m/s], block time [10 s], target point 30 m ahead on the route [30 m, ego frame, x
forward, y left], and one column per command of the navigation.

Source: Coelho 2024, section 5.3; the order and the scales are ours.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.routes.command import Command
from dohyo.sumo_networks.sensors import Observation
from dohyo.sumo_networks.sensors.path import BEHIND
from dohyo.sumo_networks.units import TICK_S

SENSORS: Final = ("speedometer", "path", "navigation")
TARGET_M: Final = 30
SPEED, LIMIT, BLOCKED, TARGET = 0, 1, 2, slice(3, 5)
MEASUREMENTS: Final = 5 + len(Command)
SPEED_SCALE, BLOCKED_SCALE, TARGET_SCALE = 10.0, 10.0, 30.0
BLOCKED_M_S, LONGEST_BLOCKED_S = 0.1, 60.0
"""Below which speed the ego counts as blocked, and the longest time that the network is told."""


class BlockTime:
    """Time for which the ego has stood.

    Attributes:
        seconds: 0 while it drives.
    """

    def __init__(self) -> None:
        self.seconds = 0.0

    def update(self, speed: float) -> None:
        """One tick at a speed [m/s]."""
        self.seconds = self.seconds + TICK_S if speed < BLOCKED_M_S else 0.0


def measured(observation: Observation, blocked_s: float) -> Float32Array:
    """(11,) see the module; the observation has the arrays of `SENSORS`."""
    path = observation["path"]
    out = np.zeros(MEASUREMENTS, dtype=np.float32)
    out[SPEED] = observation["speedometer"][0] / SPEED_SCALE
    out[LIMIT] = path[BEHIND, 4] / SPEED_SCALE
    out[BLOCKED] = min(blocked_s, LONGEST_BLOCKED_S) / BLOCKED_SCALE
    out[TARGET] = path[BEHIND + TARGET_M, :2] / TARGET_SCALE
    out[5 + int(observation["navigation"][0])] = 1.0
    return out
