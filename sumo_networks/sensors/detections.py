"""Detections: the report of a good object detector under the conditions of the episode."""

from __future__ import annotations

from typing import Self

import numpy as np
from gymnasium.spaces import Box

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.sensors.objects import COLUMNS, ROWS, Objects
from dohyo.sumo_networks.world import World

REFERENCE_M = 20.0


class Detections(Sensor):
    """(48, 8) as `Objects`, but within the range of sight, with noise in position and speed, and with dropouts.

    The noise of a position grows in proportion to the distance. No occlusion and no false positives.
    """

    name = "detections"
    track = Track.SENSORS
    space = Box(-np.inf, np.inf, (ROWS, COLUMNS), np.float32)

    def __init__(self, conditions: Conditions, rng: np.random.Generator) -> None:
        self._conditions, self._rng = conditions, rng
        self._objects = Objects()

    @classmethod
    def make(cls, conditions: Conditions, rng: np.random.Generator) -> Self:
        """Makes the sensor; see `Sensor`."""
        return cls(conditions, rng)

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        conditions, rng = self._conditions, self._rng
        true = self._objects.read(world, ego)
        # Drawn for all rows, so that the noise of one row does not depend on the number of rows.
        missing = rng.random(ROWS) < conditions.dropout
        error = rng.standard_normal((ROWS, 3)).astype(np.float32)
        distance = np.hypot(true[:, 1], true[:, 2])
        seen = (true[:, 0] >= 0) & (distance <= conditions.sight_m) & ~missing
        true[:, 1:3] += error[:, :2] * (conditions.position_noise_m * distance / REFERENCE_M)[:, None]
        true[:, 4] = np.maximum(true[:, 4] * (1.0 + conditions.speed_noise * error[:, 2]), 0.0)
        out = np.zeros((ROWS, COLUMNS), dtype=np.float32)
        out[:, 0] = -1.0
        out[: seen.sum()] = true[seen]
        return out
