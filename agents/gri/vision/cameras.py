"""Three cameras, left, centre and right: in colours to see by, in classes to learn from, and moved on demand.

A displacement is (6,) x, y, z [m], yaw, pitch, roll [deg] off the mounting, in the order of `OFF`: the pictures are
those of a car that stands and points so.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dohyo.agents.hierarchical.vision.classes import OF_LABEL
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.sensors import SENSORS, CameraConfig
from dohyo.sumo_networks.world import World

CAMERAS: Final = ("camera_64_left", "camera_64", "camera_64_right")
CENTRE: Final = 1
SIDE_PX: Final = 64
OFF: Final[Mapping[str, float]] = MappingProxyType(
    {"x_m": 1.0, "y_m": 1.5, "z_m": 0.1, "yaw_deg": 15.0, "pitch_deg": 2.0, "roll_deg": 2.0}
)
"""Largest displacement."""
MOUNTED: Final = (0.0,) * len(OFF)
"""Displacement of cameras as an agent has them."""


class Rig:
    """The cameras of one ego in one episode, in both modes."""

    def __init__(self, displacement: FloatArray, conditions: Conditions, rng: np.random.Generator) -> None:
        """Makes the sensors.

        Args:
            displacement: (6,) see the module.
            conditions: Of the episode.
            rng: Of the pictures' noise.

        Raises:
            InvalidInputError: A camera would be outside of what the sensor allows.
        """
        moved = [_moved(name, displacement) for name in CAMERAS]
        self._colours = [one.make(conditions, rng) for one in moved]
        self._classes = [one.model_copy(update={"mode": "semantic"}).make(conditions, rng) for one in moved]

    def read(self, world: World, ego: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """(3, 3, 64, 64) colours, and (3, 64, 64) classes `hierarchical.vision.classes.Seen`, by camera."""
        colours = np.stack([camera.read(world, ego) for camera in self._colours])
        return colours, OF_LABEL[np.stack([camera.read(world, ego)[0] for camera in self._classes])]


def pictures(observation: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """(3, 3, 64, 64) pictures of the sensors `CAMERAS`."""
    return np.stack([observation[name] for name in CAMERAS])


def drawn_displacement(rng: np.random.Generator) -> FloatArray:
    """(6,) each part uniform within `OFF`."""
    return np.asarray(rng.uniform(-1.0, 1.0, len(OFF)) * np.array(list(OFF.values())))


def _moved(name: str, displacement: FloatArray) -> CameraConfig:
    """The preset of a camera, displaced."""
    preset = SENSORS[name]
    if not isinstance(preset, CameraConfig) or displacement.shape != (len(OFF),):
        raise InvalidInputError(f"expected a camera and its displacement (6,), got '{name}', {displacement.shape}")
    places = {field: getattr(preset, field) + by for field, by in zip(OFF, displacement.tolist(), strict=True)}
    return CameraConfig.model_validate(preset.model_dump() | places)
