"""Develop: numba kernels that turn drawn values into pictures, labels and depths."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.rendering.perspective import FINAL, SHINES, Values


@njit(cache=True, error_model="numpy")
def develop_colours(
    value: Values,
    inverse: Float32Array,
    sky: Values,
    ray: Float32Array,
    fog: Float32Array,
    tint: Float32Array,
    horizon: Float32Array,
    range_m: float,
    grain: NDArray[np.int8],
    shift: int,
    out: NDArray[np.uint8],
) -> None:
    """Turns values into a picture: fog and light on bodies, sky behind them, grain on every pixel.

    Args:
        value: (H, W) drawn values.
        inverse: (H, W) 1 / depth, 1/m.
        sky: (H, W) 0x00BBGGRR.
        ray: (H, W) metres along a pixel's ray per metre of depth.
        fog: (D, 2) light, and share of a colour left, per half metre.
        tint: (3,) factor on colours that do not shine.
        horizon: (3,) colour of fog.
        range_m: Range of sight, m.
        grain: (G,) noise, G a power of two; empty for none.
        shift: First index in the noise.
        out: (3, H, W) output, the picture.
    """
    rows, columns = value.shape
    mask, noisy = grain.shape[0] - 1, grain.shape[0] > 0
    for row in range(rows):
        for column in range(columns):
            v, near = value[row, column], inverse[row, column]
            red, green, blue = np.float32(v & 255), np.float32((v >> 8) & 255), np.float32((v >> 16) & 255)
            if (v & FINAL) == 0:
                distance = ray[row, column] / near
                if near <= 0.0 or distance >= range_m:
                    v = sky[row, column]
                    red, green, blue = np.float32(v & 255), np.float32((v >> 8) & 255), np.float32((v >> 16) & 255)
                else:
                    step = int(distance * 2.0)
                    left, lit = fog[step, 1], fog[step, 0]
                    haze = np.float32(1.0) - left
                    if (v & SHINES) != 0:
                        red, green, blue = red * left, green * left, blue * left
                    else:
                        left *= lit
                        red = min(red * left * tint[0], np.float32(255.0))
                        green = min(green * left * tint[1], np.float32(255.0))
                        blue = min(blue * left * tint[2], np.float32(255.0))
                    red, green, blue = red + haze * horizon[0], green + haze * horizon[1], blue + haze * horizon[2]
            if noisy:
                at = (row * columns + column) * 3 + shift
                red += grain[at & mask]
                green += grain[(at + 1) & mask]
                blue += grain[(at + 2) & mask]
            out[0, row, column] = np.uint8(min(max(red, np.float32(0.0)), np.float32(255.0)))
            out[1, row, column] = np.uint8(min(max(green, np.float32(0.0)), np.float32(255.0)))
            out[2, row, column] = np.uint8(min(max(blue, np.float32(0.0)), np.float32(255.0)))


@njit(cache=True, error_model="numpy")
def add_rain(picture: NDArray[np.uint8], streaks: FloatArray, colour: Float32Array) -> None:
    """Adds short bright streaks of rain to a picture.

    Args:
        picture: (3, H, W) colours.
        streaks: (N, 3) column, row and length, each a share in [0, 1).
        colour: (3,) of the sky.
    """
    rows, columns = picture.shape[1:]
    for i in range(streaks.shape[0]):
        length = int(rows * (0.02 + 0.05 * streaks[i, 2]))
        top, left = int(streaks[i, 1] * rows), streaks[i, 0] * columns
        for k in range(length):
            row, column = top + k, int(left - 0.12 * k)
            if 0 <= row < rows and 0 <= column < columns:
                for c in range(3):
                    old = picture[c, row, column]
                    picture[c, row, column] = np.uint8(old + 0.34 * (min(colour[c] + 24.0, 255.0) - old))


@njit(cache=True, error_model="numpy")
def develop_labels(
    value: Values, inverse: Float32Array, ray: Float32Array, range_m: float, out: NDArray[np.uint8]
) -> None:
    """Labels of pixels within range; 0, as for the sky, beyond."""
    for row in range(value.shape[0]):
        for column in range(value.shape[1]):
            near = inverse[row, column]
            seen = near > 0.0 and ray[row, column] < range_m * near
            out[0, row, column] = np.uint8(value[row, column] & 255) if seen else 0


@njit(cache=True, error_model="numpy")
def develop_depth(inverse: Float32Array, ray: Float32Array, range_m: float, far: float, out: Float32Array) -> None:
    """Depth along the axis, m; `far` if nothing is within range."""
    for row in range(inverse.shape[0]):
        for column in range(inverse.shape[1]):
            near = inverse[row, column]
            seen = near > 0.0 and ray[row, column] < range_m * near
            out[0, row, column] = np.float32(1.0) / near if seen else np.float32(far)
