"""Lots drawn from a seed: the scenes of training, and the kinds of spot and the pedestrians that no one trains on."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.parking.arrays import Scenery
from dohyo.sumo_networks.parking.contact import distance_to_segment
from dohyo.sumo_networks.parking.radar import Kind, pack_box

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
def draw(lot: int, scene: int, seed: int, scenery: Scenery, starts: FloatArray) -> None:
    """Draws a lot.

    Args:
        lot: Row to write.
        scene: `Scene`.
        seed: Everything in the lot follows from it, the scene and the number of karts.
        scenery: Arrays to write to.
        starts: (K, 3) poses of the karts, to write to: x, y [m], heading [rad].
    """
    state = np.empty(1, np.uint64)
    state[0] = np.uint64(seed) * np.uint64(0x2545F4914F6CDD1D) + np.uint64(scene + 1)
    scenery.wall_count[lot] = scenery.box_count[lot] = scenery.spot_count[lot] = scenery.walker_count[lot] = 0
    scenery.ticks[lot] = DAY_TICKS
    if scene == _SIMPLE:
        _draw_simple(state, lot, scenery, starts)
        return
    width, depth = _uniform(state, 40.0, 56.0), _uniform(state, 30.0, 40.0)
    _add_wall(lot, scenery, -width / 2, -depth / 2, width / 2, -depth / 2)
    _add_wall(lot, scenery, width / 2, -depth / 2, width / 2, depth / 2)
    _add_wall(lot, scenery, width / 2, depth / 2, -width / 2, depth / 2)
    _add_wall(lot, scenery, -width / 2, depth / 2, -width / 2, -depth / 2)
    lowest = _draw_row(state, lot, scene, scenery, width, depth, starts.shape[0])
    _draw_obstacles(state, lot, scenery, width, -depth / 2 + 11.0, lowest - 7.0)
    _draw_starts(state, lot, scenery, starts, width, depth)
    if scene == _PEDESTRIANS:
        _draw_walkers(state, lot, scenery, starts, width, depth, lowest)


@njit(cache=True)
def _draw_simple(state: NDArray[np.uint64], lot: int, scenery: Scenery, starts: FloatArray) -> None:
    """Spots side by side in the open, all with heading north, and karts up to 28 m from the nearest one."""
    x, y = _uniform(state, -10.0, 10.0), _uniform(state, -10.0, 10.0)
    for number in range(starts.shape[0]):
        _add_spot(lot, scenery, x + 6.0 * number, y, math.pi / 2, 5.0, 2.5, True)
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
    state: NDArray[np.uint64], lot: int, scene: int, scenery: Scenery, width: float, depth: float, karts: int
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
    count = _whole(state, 5, 6) if scene == _PARALLEL else _whole(state, 8, 12)
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
        _add_spot(lot, scenery, x, y, heading, length, across, is_free)
        if not is_free:
            turned = heading if _uniform(state, 0.0, 1.0) < 0.7 else heading + math.pi
            turned += _uniform(state, -0.03, 0.03)
            sideways = _uniform(state, -0.1, 0.1)
            _add_box(
                lot,
                scenery,
                _CAR,
                x - sideways * math.sin(heading),
                y + sideways * math.cos(heading),
                turned,
                _uniform(state, 3.8, 4.6),
                _uniform(state, 1.65, 1.85),
            )
    return y - deep / 2


@njit(cache=True)
def _draw_obstacles(
    state: NDArray[np.uint64], lot: int, scenery: Scenery, width: float, low: float, high: float
) -> None:
    """Draws blocks and cars between the start zone and the aisle, with room for a kart between any two."""
    first = scenery.box_count[lot]
    for _ in range(_whole(state, 2, 5)):
        for _ in range(TRIES):
            x, y = _uniform(state, -width / 2 + 4.0, width / 2 - 4.0), _uniform(state, low, max(high, low + 0.5))
            heading, car = _uniform(state, -math.pi, math.pi), _uniform(state, 0.0, 1.0) < 0.5
            length = _uniform(state, 3.8, 4.6) if car else _uniform(state, 1.0, 4.0)
            across = _uniform(state, 1.65, 1.85) if car else _uniform(state, 0.5, 1.5)
            radius, fits = 0.5 * math.hypot(length, across), True
            for other in range(first, scenery.box_count[lot]):
                box = scenery.packed[lot, other]
                fits = fits and math.hypot(box[0] - x, box[1] - y) > radius + box[6] + 3.0
            if fits:
                _add_box(lot, scenery, _CAR if car else _BLOCK, x, y, heading, length, across)
                break


@njit(cache=True)
def _draw_starts(
    state: NDArray[np.uint64], lot: int, scenery: Scenery, starts: FloatArray, width: float, depth: float
) -> None:
    """Draws starts in the south of the lot, with room to drive off forwards."""
    for number in range(starts.shape[0]):
        start = starts[number]
        for _ in range(TRIES):
            start[0] = _uniform(state, -width / 2 + 3.0, width / 2 - 3.0)
            start[1] = _uniform(state, -depth / 2 + 2.5, -depth / 2 + 8.0)
            start[2] = _uniform(state, -math.pi, math.pi)
            ahead_x, ahead_y = start[0] + 3.0 * math.cos(start[2]), start[1] + 3.0 * math.sin(start[2])
            if _apart(starts, number) and _wall_distance(lot, scenery, ahead_x, ahead_y) > 3.5:
                break
        else:
            # Side by side with heading north, which always fits.
            start[0], start[1], start[2] = -width / 4 + 5.0 * number, -depth / 2 + 4.0, math.pi / 2


@njit(cache=True)
def _wall_distance(lot: int, scenery: Scenery, x: float, y: float) -> float:
    nearest = math.inf
    for wall in range(scenery.wall_count[lot]):
        nearest = min(nearest, distance_to_segment(scenery.walls[lot, wall], x, y))
    return nearest


@njit(cache=True)
def _draw_walkers(
    state: NDArray[np.uint64],
    lot: int,
    scenery: Scenery,
    starts: FloatArray,
    width: float,
    depth: float,
    highest: float,
) -> None:
    """Draws pedestrians who walk to and fro between karts and spots, around all boxes."""
    for _ in range(_whole(state, 1, 4)):
        walker = scenery.walkers[lot, scenery.walker_count[lot]]
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
            for box in range(scenery.box_count[lot]):
                packed = scenery.packed[lot, box]
                fits = fits and distance_to_segment(walker[:4], packed[0], packed[1]) > packed[6] + 0.4
            for number in range(starts.shape[0]):
                fits = fits and math.hypot(walker[0] - starts[number, 0], walker[1] - starts[number, 1]) > 4.0
            if fits:
                scenery.walker_count[lot] += 1
                break


@njit(cache=True)
def _add_wall(lot: int, scenery: Scenery, x0: float, y0: float, x1: float, y1: float) -> None:
    row = scenery.walls[lot, scenery.wall_count[lot]]
    row[0], row[1], row[2], row[3] = x0, y0, x1, y1
    scenery.wall_count[lot] += 1


@njit(cache=True)
def _add_spot(
    lot: int, scenery: Scenery, x: float, y: float, heading: float, length: float, width: float, free: bool
) -> None:
    number = scenery.spot_count[lot]
    row = scenery.spots[lot, number]
    row[0], row[1], row[2], row[3], row[4] = x, y, heading, length, width
    scenery.spot_free[lot, number] = free
    scenery.spot_count[lot] += 1


@njit(cache=True)
def _add_box(
    lot: int, scenery: Scenery, kind: int, x: float, y: float, heading: float, length: float, width: float
) -> None:
    number = scenery.box_count[lot]
    row = scenery.boxes[lot, number]
    row[0], row[1], row[2], row[3], row[4] = x, y, heading, length, width
    pack_box(row, scenery.packed[lot, number])
    scenery.box_kind[lot, number] = kind
    scenery.box_count[lot] += 1
