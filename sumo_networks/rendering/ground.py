"""Ground: numba kernels that read the pixels below the horizon from tiles."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.rendering.perspective import FINAL, Values
from dohyo.sumo_networks.rendering.tiles import SIDE_PX, TileWindow

_LOW, _BYTE, _ONE = np.uint64(255), np.uint64(8), np.uint64(1)


@njit(cache=True, inline="always")
def _spread(texel: np.uint32) -> np.int64:
    """Spreads red, green and blue 16 bits apart, so that one multiplication weights all three."""
    t = np.int64(texel)
    return (t & 0xFF) | ((t & 0xFF00) << 8) | ((t & 0xFF0000) << 16)


@njit(cache=True, error_model="numpy")
def ground_colours(
    value: Values,
    pixel: IntArray,
    points: Float32Array,
    taps: NDArray[np.int8],
    tone: Float32Array,
    ego: FloatArray,
    tint: Float32Array,
    horizon: Float32Array,
    window: TileWindow,
) -> None:
    """Colours the pixels that show ground, from tiles of one resolution.

    Args:
        value: (H * W,) image.
        pixel: (N,) indices of the pixels.
        points: (N, 4) point x, y on the ground and step dx, dy from sample to sample, m, ego frame.
        taps: (N,) number of samples over a pixel's height, 1 to 4; negative: each sample between four texels.
        tone: (N, 2) light on the ground, and share of `horizon` mixed in.
        ego: (3,) x, y [m], heading [rad].
        tint: (3,) factor on colours.
        horizon: (3,) colour of the horizon.
        window: Tiles that cover the visible ground.
    """
    cos, sin = math.cos(ego[2]), math.sin(ego[2])
    pool, table = window.pool, window.table
    scale = 1.0 / window.metres_per_px
    ox, oy = ego[0] * scale - window.left * 256.0, ego[1] * scale - window.bottom * 256.0
    cos, sin = cos * scale, sin * scale
    flat, slots, width = pool.reshape(-1), table.reshape(-1), np.uint64(table.shape[1])
    side, above = np.uint64(SIDE_PX), np.uint64(SIDE_PX * SIDE_PX)
    shares = np.array([0.0, 1.0, 1.0 / 2.0, 1.0 / 3.0, 1.0 / 4.0], dtype=np.float32)
    for i in range(pixel.shape[0]):
        gx, gy, sx, sy = points[i, 0], points[i, 1], points[i, 2], points[i, 3]
        dx, dy = cos * sx - sin * sy, sin * sx + cos * sy
        taps_here = int(taps[i])
        count = abs(taps_here)
        half = 0.5 * (count - 1)
        x, y = ox + cos * gx - sin * gy - half * dx, oy + sin * gx + cos * gy - half * dy
        total = np.int64(0)
        if taps_here < 0:
            for _ in range(count):
                u, v = np.uint64(max(int(x * 256.0) - 128, 0)), np.uint64(max(int(y * 256.0) - 128, 0))
                fx, fy = np.int64(u & _LOW), np.int64(v & _LOW)
                column, row = u >> _BYTE, v >> _BYTE
                slot = np.uint64(slots[(row >> _BYTE) * width + (column >> _BYTE)])
                at = slot * above + (row & _LOW) * side + (column & _LOW)
                a, b, c, d = flat[at], flat[at + _ONE], flat[at + side], flat[at + side + _ONE]
                if a == b and a == c and a == d:
                    total += _spread(a)
                else:
                    right, up, both = fx * (256 - fy) >> 8, (256 - fx) * fy >> 8, fx * fy >> 8
                    mixed = (256 - right - up - both) * _spread(a) + right * _spread(b)
                    mixed += up * _spread(c) + both * _spread(d)
                    total += (mixed >> 8) & 0xFF00FF00FF
                x, y = x + dx, y + dy
        else:
            for _ in range(count):
                column, row = np.uint64(max(int(x), 0)), np.uint64(max(int(y), 0))
                slot = np.uint64(slots[(row >> _BYTE) * width + (column >> _BYTE)])
                total += _spread(flat[slot * above + (row & _LOW) * side + (column & _LOW)])
                x, y = x + dx, y + dy
        lit, haze = tone[i, 0] * shares[count], tone[i, 1]
        red = int(np.float32(total & 0xFFFF) * lit * tint[0] + haze * horizon[0] + np.float32(0.5))
        green = int(np.float32((total >> 16) & 0xFFFF) * lit * tint[1] + haze * horizon[1] + np.float32(0.5))
        blue = int(np.float32(total >> 32) * lit * tint[2] + haze * horizon[2] + np.float32(0.5))
        value[pixel[i]] = min(red, 255) | (min(green, 255) << 8) | (min(blue, 255) << 16) | FINAL


@njit(cache=True, error_model="numpy")
def ground_labels(
    value: Values,
    pixel: IntArray,
    points: Float32Array,
    ego: FloatArray,
    labels: NDArray[np.uint8],
    window: TileWindow,
) -> None:
    """Labels the pixels that show ground by the surface in the middle of each pixel.

    Args:
        value: (H * W,) image.
        pixel: (N,) indices of the pixels.
        points: (N, 4) as of `ground_colours`; only x, y are used.
        ego: (3,) x, y [m], heading [rad].
        labels: (10,) labels by Surface.
        window: Tiles that cover the visible ground.
    """
    pool, table = window.pool, window.table
    scale = 1.0 / window.metres_per_px
    ox, oy = ego[0] * scale - window.left * 256.0, ego[1] * scale - window.bottom * 256.0
    cos, sin = math.cos(ego[2]) * scale, math.sin(ego[2]) * scale
    for i in range(pixel.shape[0]):
        gx, gy = points[i, 0], points[i, 1]
        column = max(int(ox + cos * gx - sin * gy), 0)
        row = max(int(oy + sin * gx + cos * gy), 0)
        texel = pool[table[row >> 8, column >> 8], row & 255, column & 255]
        value[pixel[i]] = labels[texel >> 24]
