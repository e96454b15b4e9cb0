"""Base classes of sensors and of their configurations, and the tracks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import IntEnum
from typing import Any, Self

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.config import Config, Name
from dohyo.sumo_networks.world import World

Observation = dict[str, Float32Array]
"""One array per sensor, by name."""


class Track(IntEnum):
    """Set of sensors that an agent may use; each track includes the tracks below it."""

    SENSORS = 0
    MAP = 1
    PRIVILEGED = 2


class Sensor(ABC):
    """Reads one named array of an ego's observation from the world.

    Attributes:
        name: Key in the observation.
        track: Lowest track that may use the sensor.
        space: Shape, dtype and bounds of the array.
    """

    name: str
    track: Track
    space: Box

    @classmethod
    def make(cls, conditions: Conditions, rng: np.random.Generator) -> Self:
        """Makes a sensor for one ego and episode; `rng` is its own, and sensors without noise ignore both arguments."""
        return cls()

    @abstractmethod
    def read(self, world: World, ego: int) -> NDArray[Any]:
        """Reads the array for one ego: float32, or uint8 for pictures."""


class SensorConfig(Config, ABC):
    """Configuration of a sensor with parameters; it makes one sensor per ego and episode.

    Attributes:
        name: Key in the observation.
    """

    name: Name

    @property
    @abstractmethod
    def track(self) -> Track:
        """Lowest track that may use the sensor."""

    @property
    @abstractmethod
    def space(self) -> Box:
        """Shape, dtype and bounds of the array."""

    @abstractmethod
    def make(self, conditions: Conditions, rng: np.random.Generator) -> Sensor:
        """Makes a sensor for one ego and episode."""
