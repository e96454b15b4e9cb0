"""Classes: labels of the semantic camera, merged by their meaning for a driver, and pictures as planes of classes."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.rendering.labels import Label

HEIGHT, WIDTH = 80, 160


class Seen(IntEnum):
    """Class of a pixel, for the autoencoder."""

    NONE = 0
    TERRAIN = 1
    ROAD = 2
    MARKING = 3
    CROSSING = 4
    SIDEWALK = 5
    BUILDING = 6
    STOP_SIGN = 7
    VEHICLE = 8
    BICYCLE = 9
    PEDESTRIAN = 10
    OBSTACLE = 11
    RED = 12
    YELLOW = 13
    GREEN = 14


CLASSES = len(Seen)
_MERGED = {
    Label.NONE: Seen.NONE,
    Label.TERRAIN: Seen.TERRAIN,
    Label.ROAD: Seen.ROAD,
    Label.MARKING: Seen.MARKING,
    Label.CROSSING: Seen.CROSSING,
    Label.SIDEWALK: Seen.SIDEWALK,
    Label.CYCLEWAY: Seen.SIDEWALK,
    Label.BUILDING: Seen.BUILDING,
    Label.POLE: Seen.BUILDING,
    Label.LIGHT_OFF: Seen.BUILDING,
    Label.STOP_SIGN: Seen.STOP_SIGN,
    Label.VEHICLE: Seen.VEHICLE,
    Label.EMERGENCY: Seen.VEHICLE,
    Label.BICYCLE: Seen.BICYCLE,
    Label.PEDESTRIAN: Seen.PEDESTRIAN,
    Label.OBSTACLE: Seen.OBSTACLE,
    Label.LIGHT_RED: Seen.RED,
    Label.LIGHT_YELLOW: Seen.YELLOW,
    Label.LIGHT_GREEN: Seen.GREEN,
}
OF_LABEL: NDArray[np.uint8] = np.zeros(len(Label), dtype=np.uint8)
for _label, _class in _MERGED.items():
    OF_LABEL[_label] = _class
_ROWS = np.arange(CLASSES, dtype=np.uint8)[:, None, None]


def planes(picture: NDArray[Any]) -> Float32Array:
    """(15, 80, 160) one plane per class, 1 where a pixel is of it.

    Args:
        picture: (1, 80, 160) uint8 of the sensor `camera_semantic`.

    Raises:
        InvalidInputError: The picture has another shape or type.
    """
    if picture.shape != (1, HEIGHT, WIDTH) or picture.dtype != np.uint8:
        raise InvalidInputError(
            f"expected a semantic picture, uint8 (1, {HEIGHT}, {WIDTH}), got {picture.dtype} {picture.shape}"
        )
    if int(picture.max()) >= len(Label):
        raise InvalidInputError(f"expected labels below {len(Label)}, got {int(picture.max())}")
    out: Float32Array = (OF_LABEL[picture] == _ROWS).astype(np.float32)
    return out
