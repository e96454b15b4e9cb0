"""Plan: numba kernels that draw a view from above, one bit per layer."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.rendering.perspective import span
from dohyo.sumo_networks.rendering.tiles import TileWindow

Bits = NDArray[np.uint16]


@njit(cache=True, error_model="numpy")
def warp(
    bits: Bits,
    view: FloatArray,
    ego: FloatArray,
    of_surface: Bits,
    window: TileWindow,
) -> None:
    """Transforms the ground's tiles into the ego's frame: every pixel takes the texel at its middle.

    Args:
        bits: (H, W) output.
        view: (3,) metres per pixel; distances of the top edge ahead and of the left edge to the left of the ego, m.
        ego: (3,) x, y [m], heading [rad].
        of_surface: (10,) bits by Surface.
        window: Tiles that cover the visible ground.
    """
    rows, columns = bits.shape
    pool, table = window.pool, window.table
    scale = 1.0 / window.metres_per_px
    cos, sin = math.cos(ego[2]) * scale, math.sin(ego[2]) * scale
    ox, oy = ego[0] * scale - window.left * 256.0, ego[1] * scale - window.bottom * 256.0
    step_x, step_y = sin * view[0], -cos * view[0]
    ahead, aside = view[1] - 0.5 * view[0], view[2] - 0.5 * view[0]
    for row in range(rows):
        gx = ahead - row * view[0]
        x0, y0 = ox + cos * gx - sin * aside, oy + sin * gx + cos * aside
        for column in range(columns):
            c, r = int(x0 + column * step_x), int(y0 + column * step_y)
            bits[row, column] = of_surface[pool[table[r >> 8, c >> 8], r & 255, c & 255]]


@njit(cache=True, error_model="numpy")
def _fill(bits: Bits, corners: FloatArray, count: int, bit: int) -> None:
    """Adds a bit inside a convex polygon of pixels."""
    rows, columns = bits.shape
    low, high = corners[0, 1], corners[0, 1]
    for i in range(1, count):
        low, high = min(low, corners[i, 1]), max(high, corners[i, 1])
    for row in range(max(math.ceil(low - 0.5), 0), min(math.ceil(high - 0.5), rows)):
        first, last = span(corners, count, row, columns)
        for column in range(first, last):
            bits[row, column] |= np.uint16(bit)


@njit(cache=True, error_model="numpy")
def _to_pixel(x: float, y: float, view: FloatArray, ego: FloatArray, out: FloatArray) -> None:
    cos, sin = math.cos(ego[2]), math.sin(ego[2])
    dx, dy = x - ego[0], y - ego[1]
    out[0] = (view[2] - (dy * cos - dx * sin)) / view[0]
    out[1] = (view[1] - (dx * cos + dy * sin)) / view[0]


@njit(cache=True, error_model="numpy")
def draw_boxes(bits: Bits, boxes: FloatArray, layer: IntArray, view: FloatArray, ego: FloatArray) -> None:
    """Adds the bit of each oriented box: (N, 5) x, y [m], heading [rad], length, width [m], network frame."""
    corners = np.empty((4, 2))
    for i in range(boxes.shape[0]):
        cos, sin = math.cos(boxes[i, 2]), math.sin(boxes[i, 2])
        a, b = boxes[i, 3] / 2, boxes[i, 4] / 2
        for k in range(4):
            u, v = a if k == 1 or k == 2 else -a, b if k >= 2 else -b
            _to_pixel(boxes[i, 0] + cos * u - sin * v, boxes[i, 1] + sin * u + cos * v, view, ego, corners[k])
        _fill(bits, corners, 4, layer[i])


@njit(cache=True, error_model="numpy")
def draw_arrows(
    bits: Bits, boxes: FloatArray, speed: FloatArray, seconds: float, bit: int, view: FloatArray, ego: FloatArray
) -> None:
    """Adds an arrow from the middle of each box along its heading, as long as its motion in a time."""
    corners = np.empty((4, 2))
    thick = max(0.35, 1.5 * view[0])
    for i in range(boxes.shape[0]):
        reach = speed[i] * seconds
        if reach < view[0]:
            continue
        cos, sin = math.cos(boxes[i, 2]), math.sin(boxes[i, 2])
        head = min(4.0 * thick, reach)
        shaft, half = reach - head, thick / 2
        for k in range(4):
            u, v = shaft if k == 1 or k == 2 else 0.0, half if k >= 2 else -half
            _to_pixel(boxes[i, 0] + cos * u - sin * v, boxes[i, 1] + sin * u + cos * v, view, ego, corners[k])
        _fill(bits, corners, 4, bit)
        for k in range(3):
            u, v = reach if k == 1 else shaft, 0.0 if k == 1 else (-1.4 * thick if k == 0 else 1.4 * thick)
            _to_pixel(boxes[i, 0] + cos * u - sin * v, boxes[i, 1] + sin * u + cos * v, view, ego, corners[k])
        _fill(bits, corners, 3, bit)


@njit(cache=True, error_model="numpy")
def draw_discs(
    bits: Bits, centres: FloatArray, radius: float, layer: IntArray, view: FloatArray, ego: FloatArray
) -> None:
    """Adds the bit of each disc, (N, 2) m, network frame; a bit of 0 draws nothing."""
    corners = np.empty((12, 2))
    for i in range(centres.shape[0]):
        if layer[i] == 0:
            continue
        for k in range(12):
            angle = k * math.pi / 6
            _to_pixel(
                centres[i, 0] + radius * math.cos(angle),
                centres[i, 1] + radius * math.sin(angle),
                view,
                ego,
                corners[k],
            )
        _fill(bits, corners, 12, layer[i])


@njit(cache=True, error_model="numpy")
def draw_path(bits: Bits, points: FloatArray, width: float, bit: int, view: FloatArray, ego: FloatArray) -> None:
    """Adds the bit along a line of (N, 2) points, m, network frame; joints are mitred."""
    corners = np.empty((4, 2))
    count = points.shape[0]
    half = width / 2
    for i in range(count - 1):
        for end in range(2):
            j = i + end
            a, b = max(j - 1, 0), min(j + 1, count - 1)
            tx, ty = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
            norm = max(math.hypot(tx, ty), 1e-9)
            nx, ny = -ty / norm * half, tx / norm * half
            first, second = (0, 3) if end == 0 else (1, 2)
            _to_pixel(points[j, 0] - nx, points[j, 1] - ny, view, ego, corners[first])
            _to_pixel(points[j, 0] + nx, points[j, 1] + ny, view, ego, corners[second])
        _fill(bits, corners, 4, bit)


@njit(cache=True, error_model="numpy")
def to_masks(bits: Bits, masks: NDArray[np.uint8]) -> None:
    """(C, H, W) masks: 255 where the bit of the layer is set, else 0."""
    flat = bits.reshape(-1)
    planes = masks.reshape(masks.shape[0], -1)
    for layer in range(planes.shape[0]):
        plane = planes[layer]
        for i in range(flat.shape[0]):
            plane[i] = np.uint8(255) * np.uint8((flat[i] >> np.uint16(layer)) & np.uint16(1))


@njit(cache=True, error_model="numpy")
def to_colours(bits: Bits, colours: NDArray[np.uint8], picture: NDArray[np.uint8]) -> None:
    """(3, H, W) colour of each pixel's set of layers, from a (2 ** layers, 3) table."""
    flat = bits.reshape(-1)
    planes = picture.reshape(3, -1)
    for i in range(flat.shape[0]):
        bit = flat[i]
        planes[0, i], planes[1, i], planes[2, i] = colours[bit, 0], colours[bit, 1], colours[bit, 2]
