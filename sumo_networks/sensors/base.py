"""What a sensor is, and how agents ask for one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import IntEnum
from typing import Any, Self

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.config import Config, Name
from dohyo.sumo_networks.world import World


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
    def read(self, world: World, ego: int) -> NDArray[Any]:
        """The array as one ego senses it now: float32, but uint8 where it is a picture."""


class SensorConfig(Config, ABC):
    """A sensor with parameters. Like a class of `Sensor`, it makes one per ego and episode.

    Attributes:
        name: Key in the observation.
    """

    name: Name

    @property
    @abstractmethod
    def track(self) -> Track:
        """The lowest track that may use it."""

    @property
    @abstractmethod
    def space(self) -> Box:
        """Shape, dtype and bounds of the array."""

    @abstractmethod
    def make(self, conditions: Conditions, rng: np.random.Generator) -> Sensor:
        """A sensor for one ego and episode."""
