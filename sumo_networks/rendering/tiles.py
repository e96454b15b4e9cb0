"""Tiles: the rasterised ground of a network, in squares; the least recently used squares are dropped."""

from __future__ import annotations

import math
from collections import OrderedDict
from functools import lru_cache
from itertools import count
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.rendering.surfaces import CELL_M, LONGEST_M, Ground, ground_of

TILE_PX = 256
SIDE_PX = TILE_PX + 1
CAPACITY = 128
SUPERSAMPLING = 3
THINNEST_PX = 3.0
_GENERATIONS: Final = count()
"""Of all pools of this process: a table of one is never taken for that of another."""


class TileWindow(NamedTuple):
    """Tiles that cover a rectangle, for kernels.

    Attributes:
        pool: Pool of `Tiles`.
        table: (R, C) slots in the pool.
        left: Column of the first tile.
        bottom: Row of the first tile.
        metres_per_px: Size of a texel, m.
    """

    pool: NDArray[Any]
    table: IntArray
    left: int
    bottom: int
    metres_per_px: float


class Tiles:
    """The ground of one network at one resolution.

    A tile overlaps its neighbours by one row and one column, so that a sample between texels needs one tile only. A
    texel of the pool of colours is 0xSSBBGGRR: the surface in its middle, and the mean colour of nine points. The pool
    of surfaces has bytes. Both pools are allocated at once and used slot by slot: at most CAPACITY tiles of 264 kB in
    colour (34 MB) or 66 kB without (8.5 MB), for networks of any size.

    Attributes:
        metres_per_px: Size of a texel, m.
        pool: (CAPACITY, 257, 257) uint32 or uint8; row 0 is the tile's southern edge, column 0 its western.
        generation: Number that changes when a tile is dropped; no two pools ever have the same.
    """

    def __init__(
        self, ground: Ground, metres_per_px: float, colours: FloatArray | None, capacity: int = CAPACITY
    ) -> None:
        """Allocates the pool; draws nothing yet.

        Args:
            ground: Ground to draw.
            metres_per_px: Size of a texel, m.
            colours: (10, 3) colours by Surface, 0 to 255; None for surfaces only.
            capacity: Number of tiles kept.
        """
        self.metres_per_px, self.generation = metres_per_px, next(_GENERATIONS)
        self.pool: NDArray[Any] = np.empty(
            (capacity, SIDE_PX, SIDE_PX), dtype=np.uint8 if colours is None else np.uint32
        )
        self._ground, self._colours = ground, colours
        self._slots: OrderedDict[tuple[int, int], int] = OrderedDict()

    @property
    def side_m(self) -> float:
        """Edge length of a tile, m."""
        return TILE_PX * self.metres_per_px

    def __len__(self) -> int:
        return len(self._slots)

    def table(self, x0: float, y0: float, x1: float, y1: float) -> tuple[IntArray, int, int]:
        """Slots of the tiles that cover a rectangle; draws those that are missing.

        Returns:
            (R, C) slots, column and row of the first tile.

        Raises:
            ValueError: The rectangle needs more tiles than the pool has.
        """
        side = self.side_m
        left, bottom = math.floor(x0 / side), math.floor(y0 / side)
        right, top = math.floor(x1 / side), math.floor(y1 / side)
        if (right - left + 1) * (top - bottom + 1) > len(self.pool):
            raise ValueError(
                f"expected a view of at most {len(self.pool)} tiles of {side:g} m, got one from {x0, y0} to {x1, y1}"
            )
        slots = [[self._slot(column, row) for column in range(left, right + 1)] for row in range(bottom, top + 1)]
        return np.array(slots, dtype=np.int64), left, bottom

    def _slot(self, column: int, row: int) -> int:
        slot = self._slots.get((column, row))
        if slot is not None:
            self._slots.move_to_end((column, row))
            return slot
        if len(self._slots) < len(self.pool):
            slot = len(self._slots)
        else:
            _, slot = self._slots.popitem(last=False)
            self.generation = next(_GENERATIONS)
        self._draw(slot, column * self.side_m, row * self.side_m)
        self._slots[column, row] = slot
        return slot

    def _draw(self, slot: int, x0: float, y0: float) -> None:
        if self._colours is None:
            self.pool[slot] = rasterise(self._ground, x0, y0, SIDE_PX, self.metres_per_px, THINNEST_PX)
            return
        fine = rasterise(self._ground, x0, y0, SIDE_PX * SUPERSAMPLING, self.metres_per_px / SUPERSAMPLING, 0.0)
        _average(fine, self._colours.astype(np.float32), self.pool[slot])


@lru_cache(maxsize=16)
def surface_tiles(network: RoadNetwork, metres_per_px: float, capacity: int = CAPACITY) -> Tiles:
    """Tiles of surfaces, shared by all sensors of this process with the same network and resolution."""
    return Tiles(ground_of(network), metres_per_px, None, capacity)


@lru_cache(maxsize=16)
def colour_tiles(network: RoadNetwork, metres_per_px: float, colours: tuple[tuple[int, int, int], ...]) -> Tiles:
    """Tiles of colours, shared by all sensors of this process with the same network, resolution and colours."""
    return Tiles(ground_of(network), metres_per_px, np.array(colours, dtype=np.float64))


def rasterise(
    ground: Ground, x0: float, y0: float, side_px: int, metres_per_px: float, thinnest_px: float
) -> NDArray[np.uint8]:
    """(side_px, side_px) Surface in the middle of every texel of a square.

    Args:
        ground: Ground to draw.
        x0: Western edge, m.
        y0: Southern edge, m.
        side_px: Number of texels along the square's edge.
        metres_per_px: Size of a texel, m.
        thinnest_px: Least width of markings, texels.
    """
    image = np.zeros((side_px, side_px), dtype=np.uint8)
    x1, y1 = x0 + side_px * metres_per_px, y0 + side_px * metres_per_px
    near = ground.cells.near(x0, y0, x1, y1, LONGEST_M + CELL_M / 4)
    quads, layer, surface = ground.quads[near].astype(np.float64), ground.layer[near], ground.surface[near]
    if thinnest_px > 0.0:
        thin = ground.thin[near]
        quads[thin] = _widened(quads[thin], thinnest_px * metres_per_px)
    bounds = ground.outline_bounds
    overlaps = (bounds[:, 0] < x1) & (bounds[:, 2] > x0) & (bounds[:, 1] < y1) & (bounds[:, 3] > y0)
    chosen = np.flatnonzero(overlaps)
    outlines = [ground.outlines[i] for i in chosen]
    points = np.concatenate([quads.reshape(-1, 2), *outlines])
    sizes = np.concatenate([np.full(len(quads), 4), [len(outline) for outline in outlines]]).astype(np.int64)
    start = np.concatenate([[0], np.cumsum(sizes)])
    layers = np.concatenate([layer, ground.outline_layer[chosen]])
    surfaces = np.concatenate([surface, ground.outline_surface[chosen]])
    points = (points - (x0, y0)) / metres_per_px
    _paint(image, points, start, surfaces, np.argsort(layers, kind="stable"))
    return image


def _widened(quads: FloatArray, width: float) -> FloatArray:
    """Widens quads, so that the shorter side is at least `width` [m]."""
    out = quads.copy()
    middle = quads.mean(axis=1, keepdims=True)
    edges = quads[:, [1, 2]] - quads[:, [0, 1]]
    lengths = np.hypot(edges[..., 0], edges[..., 1])
    short = np.argmin(lengths, axis=1)
    length = np.maximum(np.take_along_axis(lengths, short[:, None], axis=1), 1e-6)
    axis = np.take_along_axis(edges, short[:, None, None], axis=1) / length[..., None]
    along = ((quads - middle) * axis).sum(axis=2, keepdims=True)
    out += axis * along * (np.maximum(width / length, 1.0)[..., None] - 1.0)
    return out


@njit(cache=True)
def _paint(image: NDArray[np.uint8], points: FloatArray, start: IntArray, surface: IntArray, order: IntArray) -> None:
    """Fills polygons in order; a texel belongs to a polygon if its middle is inside (even-odd rule)."""
    rows, columns = image.shape
    cuts = np.empty(256)
    for k in order:
        first, last = start[k], start[k + 1]
        low, high = points[first, 1], points[first, 1]
        for i in range(first, last):
            low, high = min(low, points[i, 1]), max(high, points[i, 1])
        for row in range(max(math.ceil(low - 0.5), 0), min(math.ceil(high - 0.5), rows)):
            y, count = row + 0.5, 0
            xa, ya = points[last - 1, 0], points[last - 1, 1]
            for i in range(first, last):
                xb, yb = points[i, 0], points[i, 1]
                if (ya <= y) != (yb <= y) and count < 256:
                    cut = xa + (y - ya) / (yb - ya) * (xb - xa)
                    at = count
                    while at > 0 and cuts[at - 1] > cut:
                        cuts[at] = cuts[at - 1]
                        at -= 1
                    cuts[at] = cut
                    count += 1
                xa, ya = xb, yb
            for pair in range(0, count - 1, 2):
                left, right = max(math.ceil(cuts[pair] - 0.5), 0), min(math.ceil(cuts[pair + 1] - 0.5), columns)
                for column in range(left, right):
                    image[row, column] = surface[k]


@njit(cache=True)
def _average(fine: NDArray[np.uint8], colours: Float32Array, out: NDArray[np.uint32]) -> None:
    """Mean colour of 3 x 3 points, and the surface of the middle point."""
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            red, green, blue = np.float32(0.5), np.float32(0.5), np.float32(0.5)
            for i in range(3):
                for j in range(3):
                    surface = fine[3 * row + i, 3 * column + j]
                    red += colours[surface, 0] / np.float32(9.0)
                    green += colours[surface, 1] / np.float32(9.0)
                    blue += colours[surface, 2] / np.float32(9.0)
            middle = np.uint32(fine[3 * row + 1, 3 * column + 1])
            out[row, column] = (middle << 24) | (np.uint32(blue) << 16) | (np.uint32(green) << 8) | np.uint32(red)
