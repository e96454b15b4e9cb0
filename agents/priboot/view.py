"""View: the picture from above that PRIBOOT reads, as layers packed into one number per pixel, and as colours.

Source: Coelho 2024, section 5.3; the layers, their order and their colours are those of `sensors/birdseye.py`.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from dohyo.sumo_networks.sensors import SENSORS
from dohyo.sumo_networks.sensors.birdseye import BirdseyeConfig, Layer, palette

SENSOR: Final = "birdseye_far"
_CONFIG = SENSORS[SENSOR]
assert isinstance(_CONFIG, BirdseyeConfig)
CONFIG: Final = _CONFIG
LAYERS, HEIGHT, WIDTH = len(Layer), CONFIG.height, CONFIG.width


def packed(masks: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """(H, W) a bit per layer, from the sensor's (14, H, W) masks of 0 or 255."""
    out = np.zeros(masks.shape[1:], dtype=np.uint16)
    for layer, mask in enumerate(masks):
        out |= (mask & 1).astype(np.uint16) << np.uint16(layer)
    return out


def masks_of(layers: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """(N, 14, H, W) masks of 0 or 255, from (N, H, W) packed layers."""
    shifts = np.arange(LAYERS, dtype=np.uint16)[:, None, None]
    return ((layers[:, None] >> shifts) & 1).astype(np.uint8) * np.uint8(255)


def colours_of(layers: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """(N, 3, H, W) colours, from (N, H, W) packed layers."""
    return np.ascontiguousarray(np.moveaxis(palette()[layers], -1, -3))
