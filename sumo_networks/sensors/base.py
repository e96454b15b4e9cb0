"""What a sensor is, and how agents ask for one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import IntEnum
from typing import Self

import numpy as np
from gymnasium.spaces import Box

from sumo_networks.arrays import Float32Array
from sumo_networks.conditions import Conditions
from sumo_networks.world import World


class Track(IntEnum):
    """Which sensors an agent may use; each track includes those below it."""

    SENSORS = 0
    MAP = 1
    PRIVILEGED = 2


class Sensor(ABC):
    """Reads one named array of an ego's observation from the world.

    Attributes:
        name: Key in the observation.
        track: The lowest track that may use it.
        space: Shape, dtype and bounds of the array.
    """

    name: str
    track: Track
    space: Box

    @classmethod
    def make(cls, conditions: Conditions, rng: np.random.Generator) -> Self:
        """A sensor for one ego and episode; those that conditions do not touch ignore both arguments."""
        return cls()

    @abstractmethod
    def read(self, world: World, ego: int) -> Float32Array:
        """The array as one ego senses it now."""
