"""Lots drawn from a seed: the scenes of training, and the kinds of spot and the pedestrians that no one trains on."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.contact import STORED, boxes_touch, distance_to_segment, store_box
from dohyo.sumo_networks.parking.limits import MAX_BOXES, MAX_PEDESTRIANS, MAX_SPOTS, MAX_WALLS, PARALLEL_SPOTS
from dohyo.sumo_networks.parking.radar import Kind
from dohyo.sumo_networks.parking.tables import BOXES, FREE, KIND, LIMIT, SPOTS, WALKERS, WALLS, Tables

DAY_TICKS: Final = 600
ROW_GAP_M: Final = 0.5
TRIES: Final = 64
_CAR, _BLOCK = int(Kind.CAR), int(Kind.WALL)


class Scene(IntEnum):
    """Kind of lot.

    SIMPLE: one free spot per kart less than 30 m away, nothing in the way. COMPLEX: a walled lot with a row of
    perpendicular spots, most of them taken, and blocks and cars in the way. PARALLEL, ANGLED: COMPLEX with another kind
    of spot. PEDESTRIANS: COMPLEX with pedestrians.
    """

    SIMPLE = 0
    COMPLEX = 1
    PARALLEL = 2
    ANGLED = 3
    PEDESTRIANS = 4


_SIMPLE, _PARALLEL, _ANGLED, _PEDESTRIANS = (
    int(Scene.SIMPLE),
    int(Scene.PARALLEL),
    int(Scene.ANGLED),
    int(Scene.PEDESTRIANS),
)


@njit(cache=True)
def _uniform(state: NDArray[np.uint64], low: float, high: float) -> float:
    """Next number of a splitmix64 generator, in [low, high)."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return low + (high - low) * (float(z >> np.uint64(11)) / 9007199254740992.0)


@njit(cache=True)
def _whole(state: NDArray[np.uint64], low: int, high: int) -> int:
    """Next whole number, from low to high."""
    return min(low + int(_uniform(state, 0.0, 1.0) * (high - low + 1)), high)


@njit(cache=True)
def draw(lot: int, scene: int, seed: int, tables: Tables, starts: FloatArray) -> None:
    """Draws a lot.

    Args:
        lot: Row to write.
        scene: `Scene`.
        seed: Everything in the lot follows from it, the scene and the number of karts.
        tables: Arrays to write to.
        starts: (K, 3) poses of the karts, to write to: x, y [m], heading [rad].
    """
    state = np.empty(1, np.uint64)
    state[0] = np.uint64(seed) * np.uint64(0x2545F4914F6CDD1D) + np.uint64(scene + 1)
    tables.lots[lot] = 0
    tables.lots[lot, LIMIT] = DAY_TICKS
    if scene == _SIMPLE:
        _draw_simple(state, lot, tables, starts)
        return
    width, depth = _uniform(state, 40.0, 56.0), _uniform(state, 30.0, 40.0)
    _add_wall(lot, tables, -width / 2, -depth / 2, width / 2, -depth / 2)
    _add_wall(lot, tables, width / 2, -depth / 2, width / 2, depth / 2)
    _add_wall(lot, tables, width / 2, depth / 2, -width / 2, depth / 2)
    _add_wall(lot, tables, -width / 2, depth / 2, -width / 2, -depth / 2)
    lowest = _draw_row(state, lot, scene, tables, width, depth, starts.shape[0])
    _draw_obstacles(state, lot, tables, width, -depth / 2 + 11.0, lowest - 7.0)
    _draw_starts(state, lot, tables, starts, width, depth)
    if scene == _PEDESTRIANS:
        _draw_walkers(state, lot, tables, starts, width, depth, lowest)


@njit(cache=True)
def _draw_simple(state: NDArray[np.uint64], lot: int, tables: Tables, starts: FloatArray) -> None:
    """Spots side by side in the open, all with heading north, and karts up to 28 m from the nearest one."""
    x, y = _uniform(state, -10.0, 10.0), _uniform(state, -10.0, 10.0)
    for number in range(starts.shape[0]):
        _add_spot(lot, tables, x + 6.0 * number, y, math.pi / 2, 5.0, 2.5, True)
    for number in range(starts.shape[0]):
        for _ in range(TRIES):
            distance, bearing = _uniform(state, 5.0, 28.0), _uniform(state, -math.pi, math.pi)
            starts[number, 0] = x + 6.0 * number + distance * math.cos(bearing)
            starts[number, 1] = y + distance * math.sin(bearing)
            starts[number, 2] = _uniform(state, -math.pi, math.pi)
            if _apart(starts, number):
                break


@njit(cache=True)
def _apart(starts: FloatArray, number: int) -> bool:
    """Whether a start is at least 4 m from the starts before it."""
    for other in range(number):
        if math.hypot(starts[other, 0] - starts[number, 0], starts[other, 1] - starts[number, 1]) < 4.0:
            return False
    return True


@njit(cache=True)
def _draw_row(
    state: NDArray[np.uint64], lot: int, scene: int, tables: Tables, width: float, depth: float, karts: int
) -> float:
    """Draws the row of spots along the north wall; returns the y of its southern edge, m."""
    heading, length, across = math.pi / 2, 5.0, 2.5
    if scene == _PARALLEL:
        heading, length, across = (0.0 if _uniform(state, 0.0, 1.0) < 0.5 else math.pi), 6.0, 2.3
    elif scene == _ANGLED:
        heading = math.radians(60.0 if _uniform(state, 0.0, 1.0) < 0.5 else 120.0)
    sin, cos = abs(math.sin(heading)), abs(math.cos(heading))
    pitch = length if scene == _PARALLEL else across / sin
    deep = across if scene == _PARALLEL else length * sin + across * cos
    count = _whole(state, PARALLEL_SPOTS[0], PARALLEL_SPOTS[1]) if scene == _PARALLEL else _whole(state, 8, 12)
    y = depth / 2 - ROW_GAP_M - deep / 2
    room = width / 2 - 2.0 - 0.5 * (pitch * (count - 1) + length * cos + across * sin)
    first = _uniform(state, -room, room) - 0.5 * pitch * (count - 1)
    free = max(_whole(state, 1, 3), karts) if karts == 1 else karts
    left = count
    for number in range(count):
        is_free = _uniform(state, 0.0, 1.0) * left < free
        left -= 1
        free -= 1 if is_free else 0
        x = first + pitch * number
        _add_spot(lot, tables, x, y, heading, length, across, is_free)
        if not is_free:
            turned = heading if _uniform(state, 0.0, 1.0) < 0.7 else heading + math.pi
            turned += _uniform(state, -0.03, 0.03)
            sideways = _uniform(state, -0.1, 0.1)
            _add_box(
                lot,
                tables,
                _CAR,
                x - sideways * math.sin(heading),
                y + sideways * math.cos(heading),
                turned,
                _uniform(state, 3.8, 4.6),
                _uniform(state, 1.65, 1.85),
            )
    return y - deep / 2


@njit(cache=True)
def _draw_obstacles(state: NDArray[np.uint64], lot: int, tables: Tables, width: float, low: float, high: float) -> None:
    """Draws blocks and cars between the start zone and the aisle, with room for a kart between any two."""
    first = tables.lots[lot, BOXES]
    for _ in range(_whole(state, 2, 5)):
        for _ in range(TRIES):
            x, y = _uniform(state, -width / 2 + 4.0, width / 2 - 4.0), _uniform(state, low, max(high, low + 0.5))
            heading, car = _uniform(state, -math.pi, math.pi), _uniform(state, 0.0, 1.0) < 0.5
            length = _uniform(state, 3.8, 4.6) if car else _uniform(state, 1.0, 4.0)
            across = _uniform(state, 1.65, 1.85) if car else _uniform(state, 0.5, 1.5)
            radius, fits = 0.5 * math.hypot(length, across), True
            for other in range(first, tables.lots[lot, BOXES]):
                box = tables.boxes[lot * MAX_BOXES + other]
                fits = fits and math.hypot(box[0] - x, box[1] - y) > radius + box[7] + 3.0
            if fits:
                _add_box(lot, tables, _CAR if car else _BLOCK, x, y, heading, length, across)
                break


@njit(cache=True)
def _draw_starts(
    state: NDArray[np.uint64], lot: int, tables: Tables, starts: FloatArray, width: float, depth: float
) -> None:
    """Draws starts in the south of the lot, in contact with no box, and with room to drive off forwards."""
    for number in range(starts.shape[0]):
        start = starts[number]
        for _ in range(TRIES):
            start[0] = _uniform(state, -width / 2 + 3.0, width / 2 - 3.0)
            start[1] = _uniform(state, -depth / 2 + 2.5, -depth / 2 + 8.0)
            start[2] = _uniform(state, -math.pi, math.pi)
            if _is_roomy(lot, tables, starts, number):
                break
        else:
            start[0], start[1], start[2] = -width / 4 + 5.0 * number, -depth / 2 + 4.0, math.pi / 2
            if abs(start[0]) > width / 2 - 3.0 or not _is_roomy(lot, tables, starts, number):
                _find_start(lot, tables, starts, number, width, depth)


@njit(cache=True)
def _find_start(lot: int, tables: Tables, starts: FloatArray, number: int, width: float, depth: float) -> None:
    """Gives a kart the first roomy place with heading north on a grid of a metre, row by row from the south-west.

    Up to 8 karts leave such a place in every lot, and no number is drawn.
    """
    start = starts[number]
    for row in range(int(depth - 5.0)):
        for column in range(int(width - 6.0)):
            start[0], start[1] = -width / 2 + 3.0 + column, -depth / 2 + 2.5 + row
            if _is_roomy(lot, tables, starts, number):
                return


@njit(cache=True)
def _is_roomy(lot: int, tables: Tables, starts: FloatArray, number: int) -> bool:
    """Whether a start inside the walls touches no box, is apart from those before it, and has room ahead."""
    x, y, heading = starts[number]
    ahead_x, ahead_y = x + 3.0 * math.cos(heading), y + 3.0 * math.sin(heading)
    if not (_apart(starts, number) and _wall_distance(lot, tables, ahead_x, ahead_y) > 3.5):
        return False
    body = np.empty((1, STORED))
    store_box(body, 0, x, y, heading, kart.LENGTH_M, kart.WIDTH_M)
    return not _touches_box(lot, tables, body)


@njit(cache=True)
def _touches_box(lot: int, tables: Tables, body: FloatArray) -> bool:
    """Whether a (1, 8) stored box touches a block or parked car."""
    touches = False
    for box in range(tables.lots[lot, BOXES]):
        touches = touches or boxes_touch(body, 0, tables.boxes, lot * MAX_BOXES + box)
    return touches


@njit(cache=True)
def _wall_distance(lot: int, tables: Tables, x: float, y: float) -> float:
    nearest = math.inf
    for wall in range(tables.lots[lot, WALLS]):
        nearest = min(nearest, _way_distance(tables.walls[lot * MAX_WALLS + wall], x, y))
    return nearest


@njit(cache=True)
def _way_distance(row: FloatArray, x: float, y: float) -> float:
    """Distance of a point to the way between two points, the first four numbers of a row."""
    return distance_to_segment(row[0], row[1], row[2], row[3], x, y)


@njit(cache=True)
def _draw_walkers(
    state: NDArray[np.uint64],
    lot: int,
    tables: Tables,
    starts: FloatArray,
    width: float,
    depth: float,
    highest: float,
) -> None:
    """Draws pedestrians who walk to and fro between karts and spots, around all boxes."""
    for _ in range(_whole(state, 1, 4)):
        walker = tables.walkers[lot * MAX_PEDESTRIANS + tables.lots[lot, WALKERS]]
        for _ in range(TRIES):
            walker[0], walker[2] = (
                _uniform(state, -width / 2 + 1, width / 2 - 1),
                _uniform(state, -width / 2 + 1, width / 2 - 1),
            )
            walker[1], walker[3] = (
                _uniform(state, -depth / 2 + 1, highest - 1),
                _uniform(state, -depth / 2 + 1, highest - 1),
            )
            walker[4], walker[5] = _uniform(state, 0.8, 1.5), 0.3
            fits = math.hypot(walker[2] - walker[0], walker[3] - walker[1]) > 6.0
            for box in range(tables.lots[lot, BOXES]):
                stored = tables.boxes[lot * MAX_BOXES + box]
                fits = fits and _way_distance(walker, stored[0], stored[1]) > stored[7] + 0.4
            for number in range(starts.shape[0]):
                fits = fits and math.hypot(walker[0] - starts[number, 0], walker[1] - starts[number, 1]) > 4.0
            if fits:
                tables.lots[lot, WALKERS] += 1
                break


@njit(cache=True)
def _add_wall(lot: int, tables: Tables, x0: float, y0: float, x1: float, y1: float) -> None:
    row = tables.walls[lot * MAX_WALLS + tables.lots[lot, WALLS]]
    row[0], row[1], row[2], row[3] = x0, y0, x1, y1
    tables.lots[lot, WALLS] += 1


@njit(cache=True)
def _add_spot(
    lot: int, tables: Tables, x: float, y: float, heading: float, length: float, width: float, free: bool
) -> None:
    row = lot * MAX_SPOTS + tables.lots[lot, SPOTS]
    store_box(tables.spots, row, x, y, heading, length, width)
    tables.spots[row, FREE] = 1.0 if free else 0.0
    tables.lots[lot, SPOTS] += 1


@njit(cache=True)
def _add_box(
    lot: int, tables: Tables, kind: int, x: float, y: float, heading: float, length: float, width: float
) -> None:
    row = lot * MAX_BOXES + tables.lots[lot, BOXES]
    store_box(tables.boxes, row, x, y, heading, length, width)
    tables.boxes[row, KIND] = kind
    tables.lots[lot, BOXES] += 1
