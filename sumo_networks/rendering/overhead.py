"""Overhead: frames of an episode from above, north up, centred on an ego. For people, not for sensors."""

from __future__ import annotations

import math
from enum import IntEnum
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.portable_math import arctan2
from dohyo.sumo_networks.rendering.plan import draw_boxes, draw_discs, draw_path, warp
from dohyo.sumo_networks.rendering.surfaces import CellIndex, Surface
from dohyo.sumo_networks.rendering.tiles import CAPACITY, TILE_PX, TileWindow, surface_tiles
from dohyo.sumo_networks.world import ActorKind, LightState, World

SIDE_PX = 480
METRES_PER_PX = 0.15
SUPERSAMPLING = 3
ROUTE_M, ROUTE_WIDTH_M = 200, 2.4
STOP_LINE_M = 0.6
PERSON_M = 0.5
"""Radius of the disc that represents a pedestrian, m."""

FRAME_SHAPE = (SIDE_PX, SIDE_PX, 3)


class Layer(IntEnum):
    """Layer of a pixel, bottom first; a pixel has the colour of its last layer."""

    SIDEWALK = 0
    ROAD = 1
    ROUTE = 2
    LINE = 3
    STOP_LINE = 4
    RED = 5
    YELLOW = 6
    GREEN = 7
    STATIC = 8
    BICYCLE = 9
    VEHICLE = 10
    EMERGENCY = 11
    PEDESTRIAN = 12
    EGO = 13
    NOTCH = 14


SAND = (250, 248, 244)
COLOURS: dict[Layer, tuple[int, int, int]] = {
    Layer.SIDEWALK: (239, 235, 227),
    Layer.ROAD: (217, 212, 202),
    Layer.ROUTE: (190, 182, 204),
    Layer.LINE: (250, 248, 244),
    Layer.STOP_LINE: (154, 146, 132),
    Layer.RED: (179, 54, 46),
    Layer.YELLOW: (222, 160, 40),
    Layer.GREEN: (46, 125, 91),
    Layer.STATIC: (138, 122, 98),
    Layer.BICYCLE: (0, 114, 178),
    Layer.VEHICLE: (88, 96, 108),
    Layer.EMERGENCY: (213, 94, 0),
    Layer.PEDESTRIAN: (31, 35, 40),
    Layer.EGO: (91, 75, 138),
    Layer.NOTCH: (250, 248, 244),
}


class Overhead:
    """Draws frames of 480 x 480 px, 72 m wide: sand, lanes, lights at their stop lines, boxes with a notch in front."""

    def __init__(self) -> None:
        side = SIDE_PX * SUPERSAMPLING
        half = SIDE_PX * METRES_PER_PX / 2
        self._view = np.array([METRES_PER_PX / SUPERSAMPLING, half, half])
        self._half = half
        self._bits = np.zeros((side, side), dtype=np.uint16)

    def frame(self, world: World, ego: int) -> NDArray[np.uint8]:
        """(480, 480, 3) RGB picture of the surroundings of one ego.

        Args:
            world: The current world.
            ego: Index of the ego in the middle.
        """
        x, y = world.egos.position[ego].tolist()
        place = np.array([x, y, math.pi / 2])
        box = (x - self._half, y - self._half, x + self._half, y + self._half)
        self._draw_ground(world.network, place, box)
        self._draw_route(world, ego, place)
        self._draw_stop_lines(world, place, box)
        self._draw_actors(world, place)
        out = np.empty(FRAME_SHAPE, dtype=np.uint8)
        _average(self._bits, _palette(), out)
        return out

    def _draw_ground(self, network: RoadNetwork, place: FloatArray, box: tuple[float, float, float, float]) -> None:
        texel = float(self._view[0])
        capacity = max(CAPACITY, math.ceil(2 * self._half / texel / TILE_PX + 2) ** 2)
        tiles = surface_tiles(network, texel, capacity)
        table = tiles.table(box[0] - 1.0, box[1] - 1.0, box[2] + 1.0, box[3] + 1.0)
        warp(self._bits, self._view, place, _OF_SURFACE, TileWindow(tiles.pool, *table, texel))

    def _draw_route(self, world: World, ego: int, place: FloatArray) -> None:
        route = world.routes[ego]
        first = route.index(float(world.egos.progress[ego]))
        points = route.position[first : first + ROUTE_M + 1]
        draw_path(self._bits, points, ROUTE_WIDTH_M, 1 << Layer.ROUTE, self._view, place)

    def _draw_stop_lines(self, world: World, place: FloatArray, box: tuple[float, float, float, float]) -> None:
        boxes, rows, cells = _stop_lines(world.network)
        near = cells.near(*box)
        layer = np.array([_OF_LIGHT[_light(world, row)] for row in rows[near].tolist()], dtype=np.int64)
        draw_boxes(self._bits, boxes[near], layer, self._view, place)

    def _draw_actors(self, world: World, place: FloatArray) -> None:
        actors, view = world.actors, self._view
        on_foot = actors.kind == ActorKind.PEDESTRIAN
        boxes, layer = actors.boxes()[~on_foot], _OF_KIND[actors.kind[~on_foot]]
        egos = world.egos.boxes()[world.egos.active]
        boxes = np.concatenate([boxes, egos])
        layer = np.concatenate([layer, np.full(len(egos), 1 << Layer.EGO)])
        draw_boxes(self._bits, boxes, layer, view, place)
        moving = layer != 1 << Layer.STATIC
        draw_boxes(self._bits, _notches(boxes[moving]), np.full(moving.sum(), 1 << Layer.NOTCH), view, place)
        people = actors.position[on_foot]
        draw_discs(self._bits, people, PERSON_M, np.full(len(people), 1 << Layer.PEDESTRIAN), view, place)


@njit(cache=True, error_model="numpy")
def _average(bits: NDArray[np.uint16], colours: NDArray[np.uint8], out: NDArray[np.uint8]) -> None:
    """(H, W, 3) mean colour of the 3 x 3 samples of each pixel, from a (2 ** layers, 3) table."""
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            red, green, blue = 4, 4, 4
            for i in range(SUPERSAMPLING):
                for j in range(SUPERSAMPLING):
                    colour = colours[bits[SUPERSAMPLING * row + i, SUPERSAMPLING * column + j]]
                    red, green, blue = red + colour[0], green + colour[1], blue + colour[2]
            out[row, column, 0] = red // SUPERSAMPLING**2
            out[row, column, 1] = green // SUPERSAMPLING**2
            out[row, column, 2] = blue // SUPERSAMPLING**2


def _notches(boxes: FloatArray) -> FloatArray:
    """(N, 5) a bar across the front third of each box."""
    x, y, heading, length, width = boxes.T
    ahead = 0.28 * length
    return np.column_stack(
        [x + ahead * np.cos(heading), y + ahead * np.sin(heading), heading, 0.12 * length, 0.7 * width]
    )


def _light(world: World, row: int) -> LightState:
    """LightState at a stop line: the most permissive of its lane's signals, OFF if there is none."""
    network = world.network
    if not network.stop_lines.lit[row]:
        return LightState.OFF
    signals = network.connections.signal[network.connections_from(int(network.stop_lines.lane[row]))]
    return LightState(max(world.signals[signals[signals >= 0]], default=LightState.OFF))


@lru_cache(maxsize=4)
def _stop_lines(network: RoadNetwork) -> tuple[FloatArray, IntArray, CellIndex]:
    """(S, 5) boxes of the stop lines, their rows in the network, sorted by cell, and the cells."""
    segment = network.stop_lines.segment
    middle, across = (segment[:, :2] + segment[:, 2:]) / 2, segment[:, 2:] - segment[:, :2]
    heading, length = arctan2(across[:, 1], across[:, 0]), np.hypot(across[:, 0], across[:, 1])
    boxes = np.column_stack([middle, heading, length, np.full(len(length), STOP_LINE_M)])
    cells = CellIndex(middle)
    return boxes[cells.order], cells.order, cells


@lru_cache(maxsize=1)
def _palette() -> NDArray[np.uint8]:
    """(2 ** 15, 3) the colour of the last layer of every set of layers."""
    bits = np.arange(1 << len(Layer))
    out = np.empty((len(bits), 3), dtype=np.uint8)
    out[:] = SAND
    for layer in Layer:
        out[(bits >> layer) & 1 == 1] = COLOURS[layer]
    return out


_OF_SURFACE: NDArray[np.uint16] = np.zeros(len(Surface), dtype=np.uint16)
_OF_SURFACE[[Surface.ROAD, Surface.CROSSING, Surface.STOP_LINE]] = 1 << Layer.ROAD
_OF_SURFACE[[Surface.LINE, Surface.STRIPE]] = 1 << Layer.ROAD | 1 << Layer.LINE
_OF_SURFACE[[Surface.SIDEWALK, Surface.CYCLEWAY, Surface.KERB]] = 1 << Layer.SIDEWALK

_OF_KIND: IntArray = np.full(len(ActorKind), 1 << Layer.VEHICLE, dtype=np.int64)
_OF_KIND[ActorKind.BICYCLE] = 1 << Layer.BICYCLE
_OF_KIND[ActorKind.EMERGENCY] = 1 << Layer.EMERGENCY
_OF_KIND[ActorKind.STATIC] = 1 << Layer.STATIC

_OF_LIGHT = {
    LightState.OFF: 1 << Layer.STOP_LINE,
    LightState.RED: 1 << Layer.RED,
    LightState.YELLOW: 1 << Layer.YELLOW,
    LightState.GREEN: 1 << Layer.GREEN,
}
