"""Kernels over all lots: the beginning of an episode, and one tick of 0.1 s.

Rows and columns are those of `tables`. Helpers take the few tables that they use.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.geometry import wrap
from dohyo.sumo_networks.parking import kart, rules
from dohyo.sumo_networks.parking.contact import STORED, boxes_touch, distance_to, touches_segment
from dohyo.sumo_networks.parking.limits import MAX_BOXES, MAX_PEDESTRIANS, MAX_SPOTS, MAX_WALLS
from dohyo.sumo_networks.parking.radar import Kind
from dohyo.sumo_networks.parking.rules import Outcome
from dohyo.sumo_networks.parking.tables import (
    BOXES,
    ENDED,
    FREE,
    GEAR,
    HELD,
    KIND,
    LIMIT,
    OUTCOME,
    SHUNTS,
    SPOTS,
    TARGET,
    TICK,
    TOUCHED,
    WAITED,
    WALK_RADIUS,
    WALK_SPEED,
    WALK_X,
    WALK_Y,
    WALKED,
    WALKERS,
    WALLS,
    Tables,
)

_RUNNING, _PARKED, _COLLIDED = int(Outcome.RUNNING), int(Outcome.PARKED), int(Outcome.COLLIDED)
_TIMED_OUT, _REVERSED, _MISALIGNED = int(Outcome.TIMED_OUT), int(Outcome.REVERSED), int(Outcome.MISALIGNED)
_STRAYED, _ABSENT = int(Outcome.STRAYED), int(Outcome.ABSENT)
_WALL, _KART, _PEDESTRIAN = int(Kind.WALL), int(Kind.KART), int(Kind.PEDESTRIAN)
WAITS_M: Final = 0.6
"""A pedestrian waits while the next step would lead nearer than this to a kart."""
TURNS_AFTER_S: Final = 2.0
"""A pedestrian that has waited for so long turns back, so that it and a kart do not wait for each other for ever."""
_TRAVEL_M: Final = 1.01 * kart.MAX_SPEED_MPS * kart.TICK_S


@njit(cache=True)
def begin(lot: int, starts: FloatArray, tables: Tables) -> None:
    """Begins an episode in a lot, with (K', 3) karts at rest: x, y [m], heading [rad]; the other karts are absent."""
    karts, counts, walkers = tables.karts, tables.counts, tables.walkers
    size = karts.shape[0] // tables.lots.shape[0]
    for number in range(size):
        row, there = lot * size + number, number < starts.shape[0]
        karts[row] = 0.0
        counts[row] = 0
        counts[row, OUTCOME] = _RUNNING if there else _ABSENT
        if there:
            heading = wrap(starts[number, 2])
            karts[row, kart.X], karts[row, kart.Y] = starts[number, 0], starts[number, 1]
            karts[row, kart.HEADING] = heading
            karts[row, kart.COS], karts[row, kart.SIN] = math.cos(heading), math.sin(heading)
    for row in range(lot * MAX_PEDESTRIANS, (lot + 1) * MAX_PEDESTRIANS):
        walkers[row, WALKED], walkers[row, WALK_X], walkers[row, WALK_Y] = 0.0, walkers[row, 0], walkers[row, 1]
        walkers[row, WAITED] = 0.0
    tables.lots[lot, TICK] = 0
    for row in range(lot * size, lot * size + starts.shape[0]):
        for even_taken in (True, False):
            _choose_target(lot, row, size, tables.spots, tables.lots[lot, SPOTS], karts, counts, even_taken)


@njit(cache=True)
def advance(tables: Tables, actions: FloatArray, rewards: FloatArray) -> None:
    """Advances every lot in which a kart's episode runs by one tick.

    Args:
        tables: Of N lots, which are changed.
        actions: (N * K, 3) shares of motor torque, steering angle, brake torque, in [-1, 1].
        rewards: (N * K,) to write to; 0 where no episode ran.
    """
    walls, boxes, spots, walkers, lots, rule, karts, counts = tables
    size = karts.shape[0] // lots.shape[0]
    bodies, before = np.zeros((size, STORED)), np.zeros(size)
    near_boxes, near_walls = np.zeros(MAX_BOXES, np.int64), np.zeros(MAX_WALLS, np.int64)
    rewards[:] = 0.0
    for lot in range(lots.shape[0]):
        first, radius, running = lot * size, rule[lot, rules.RADIUS], 0
        for number in range(size):
            row = first + number
            running += counts[row, OUTCOME] == _RUNNING
            _write_body(karts, row, bodies, number)
            before[number] = _distance(spots, lot * MAX_SPOTS + counts[row, TARGET], bodies, number)
        if running == 0:
            continue
        walker_count = _walk(lot, walkers, lots[lot, WALKERS], bodies, counts)
        box_count = _find_boxes(lot, boxes, lots[lot, BOXES], bodies, near_boxes)
        wall_count = _find_walls(lot, walls, lots[lot, WALLS], bodies, near_walls)
        # Karts that cannot meet take all substeps of a tick one after the other, and with nothing near in one go.
        meeting = _karts_are_near(first, bodies, counts)
        free = not meeting and box_count + wall_count + walker_count == 0
        for _ in range(kart.SUBSTEPS if meeting else 1):
            for row in range(first, first + size):
                if counts[row, OUTCOME] != _RUNNING:
                    continue
                spot, steps = lot * MAX_SPOTS + counts[row, TARGET], kart.SUBSTEPS if free else 1
                for _ in range(1 if meeting or free else kart.SUBSTEPS):
                    _drive(row, steps, actions, karts, counts, spots, spot, radius)
                    _write_body(karts, row, bodies, row - first)
                    if box_count > 0:
                        _touch_box(row, bodies, row - first, counts, boxes, near_boxes, box_count)
                    if wall_count > 0:
                        _touch_wall(row, bodies, row - first, counts, walls, near_walls, wall_count)
                    if walker_count > 0:
                        _touch_walker(row, bodies, row - first, counts, walkers, lot * MAX_PEDESTRIANS, walker_count)
                    if counts[row, TOUCHED] != 0:
                        break
            if meeting:
                _touch_karts(first, bodies, counts)
            for row in range(first, first + size):
                if counts[row, OUTCOME] == _RUNNING and counts[row, TOUCHED] != 0:
                    counts[row, OUTCOME] = _COLLIDED
        lots[lot, TICK] += 1
        for number in range(size):
            row = first + number
            if counts[row, OUTCOME] == _ABSENT or counts[row, ENDED] != 0:
                continue
            distance = _distance(spots, lot * MAX_SPOTS + counts[row, TARGET], bodies, number)
            if counts[row, OUTCOME] == _RUNNING:
                counts[row, OUTCOME] = _judged(lot, row, actions[row, 0], distance, lots, rule, karts, counts, spots)
            rewards[row] = rule[lot, rules.PROGRESS] * (before[number] - distance)
            if counts[row, OUTCOME] != _RUNNING:
                rewards[row] += 1.0 if counts[row, OUTCOME] == _PARKED else -1.0
                if counts[row, OUTCOME] == _PARKED and rule[lot, rules.ALIGNMENT] != 0.0:
                    aligned = alignment_of(karts, row, spots, lot * MAX_SPOTS + counts[row, TARGET])
                    rewards[row] += rule[lot, rules.ALIGNMENT] * aligned
                counts[row, ENDED] = lots[lot, TICK]
                karts[row, kart.SPEED] = 0.0
        if size > 1:
            for row in range(first, first + size):
                _keep_or_change_target(lot, row, size, spots, lots[lot, SPOTS], karts, counts)


@njit(cache=True)
def _write_body(karts: FloatArray, row: int, bodies: FloatArray, number: int) -> None:
    """Writes the stored box of a kart."""
    bodies[number, 0], bodies[number, 1] = karts[row, kart.X], karts[row, kart.Y]
    bodies[number, 2], bodies[number, 3], bodies[number, 4] = karts[row, kart.HEADING], kart.LENGTH_M, kart.WIDTH_M
    bodies[number, 5], bodies[number, 6] = karts[row, kart.COS], karts[row, kart.SIN]
    bodies[number, 7] = kart.RADIUS_M


@njit(cache=True)
def _distance(spots: FloatArray, spot: int, bodies: FloatArray, number: int) -> float:
    """Distance of a kart's centre to the centre of a spot, m."""
    dx, dy = spots[spot, 0] - bodies[number, 0], spots[spot, 1] - bodies[number, 1]
    return math.sqrt(dx * dx + dy * dy)


@njit(cache=True)
def _find_boxes(lot: int, boxes: FloatArray, count: int, bodies: FloatArray, near: IntArray) -> int:
    """Writes the rows of the boxes that a kart may touch in this tick to `near`; returns their number."""
    found = 0
    for box in range(lot * MAX_BOXES, lot * MAX_BOXES + count):
        for number in range(bodies.shape[0]):
            dx, dy = boxes[box, 0] - bodies[number, 0], boxes[box, 1] - bodies[number, 1]
            reach = boxes[box, 7] + kart.RADIUS_M + _TRAVEL_M
            if dx * dx + dy * dy < reach * reach:
                near[found] = box
                found += 1
                break
    return found


@njit(cache=True)
def _find_walls(lot: int, walls: FloatArray, count: int, bodies: FloatArray, near: IntArray) -> int:
    """Writes the rows of the walls that a kart may touch in this tick to `near`; returns their number."""
    found, reach = 0, kart.RADIUS_M + _TRAVEL_M
    for wall in range(lot * MAX_WALLS, lot * MAX_WALLS + count):
        left, right = min(walls[wall, 0], walls[wall, 2]) - reach, max(walls[wall, 0], walls[wall, 2]) + reach
        low, high = min(walls[wall, 1], walls[wall, 3]) - reach, max(walls[wall, 1], walls[wall, 3]) + reach
        for number in range(bodies.shape[0]):
            if left < bodies[number, 0] < right and low < bodies[number, 1] < high:
                near[found] = wall
                found += 1
                break
    return found


@njit(cache=True)
def _karts_are_near(first: int, bodies: FloatArray, counts: IntArray) -> bool:
    """Whether a driving kart may touch another kart in this tick."""
    reach = 2.0 * (kart.RADIUS_M + _TRAVEL_M)
    for number in range(bodies.shape[0]):
        if counts[first + number, OUTCOME] != _RUNNING:
            continue
        for other in range(bodies.shape[0]):
            dx, dy = bodies[number, 0] - bodies[other, 0], bodies[number, 1] - bodies[other, 1]
            if dx * dx + dy * dy < reach * reach and other != number and counts[first + other, OUTCOME] != _ABSENT:
                return True
    return False


@njit(cache=True)
def _drive(
    row: int,
    steps: int,
    actions: FloatArray,
    karts: FloatArray,
    counts: IntArray,
    spots: FloatArray,
    spot: int,
    radius: float,
) -> None:
    """Moves a kart by some substeps, and counts its changes of direction and its time in place."""
    torque, steering, brake = actions[row, 0], actions[row, 1], actions[row, 2]
    held, gear = counts[row, HELD], counts[row, GEAR]
    for _ in range(steps):
        kart.drive(karts, row, torque, steering, brake)
        speed = karts[row, kart.SPEED]
        if speed != 0.0:
            now = 1 if speed > 0.0 else -1
            if now == -gear:
                counts[row, SHUNTS] += 1
            gear = now
        dx, dy = spots[spot, 0] - karts[row, kart.X], spots[spot, 1] - karts[row, kart.Y]
        held = held + 1 if dx * dx + dy * dy < radius * radius else 0
    counts[row, HELD], counts[row, GEAR] = held, gear


@njit(cache=True)
def _walk(lot: int, walkers: FloatArray, count: int, bodies: FloatArray, counts: IntArray) -> int:
    """Moves the pedestrians of a lot for one tick; those whose next step leads to a kart wait, and at last turn.

    Returns:
        The number of pedestrians; 0 if no kart may touch one of them in this tick.
    """
    first, may_touch = lot * bodies.shape[0], False
    for row in range(lot * MAX_PEDESTRIANS, lot * MAX_PEDESTRIANS + count):
        x0, y0, x1, y1 = walkers[row, 0], walkers[row, 1], walkers[row, 2], walkers[row, 3]
        length = math.hypot(x1 - x0, y1 - y0)
        walked = walkers[row, WALKED] + walkers[row, WALK_SPEED] * kart.TICK_S
        share = walked % (2.0 * length) / length if length > 0.0 else 0.0
        share = 2.0 - share if share > 1.0 else share
        x, y, waits = x0 + share * (x1 - x0), y0 + share * (y1 - y0), False
        radius = walkers[row, WALK_RADIUS]
        for number in range(bodies.shape[0]):
            dx, dy, reach = bodies[number, 0] - x, bodies[number, 1] - y, radius + kart.RADIUS_M + WAITS_M
            if dx * dx + dy * dy > reach * reach or counts[first + number, OUTCOME] == _ABSENT:
                continue
            may_touch, distance = True, distance_to(bodies, number, x, y)
            before = distance_to(bodies, number, walkers[row, WALK_X], walkers[row, WALK_Y])
            waits = waits or (distance < radius + WAITS_M and distance < before)
        walkers[row, WAITED] = walkers[row, WAITED] + kart.TICK_S if waits else 0.0
        if not waits:
            walkers[row, WALKED], walkers[row, WALK_X], walkers[row, WALK_Y] = walked, x, y
        elif walkers[row, WAITED] > TURNS_AFTER_S:
            walkers[row, WALKED], walkers[row, WAITED] = 2.0 * length - walkers[row, WALKED] % (2.0 * length), 0.0
    return count if may_touch else 0


@njit(cache=True)
def _touch_box(
    row: int, bodies: FloatArray, number: int, counts: IntArray, boxes: FloatArray, near: IntArray, nearby: int
) -> None:
    """Notes the kind of a box that a kart touches."""
    for index in range(nearby):
        if boxes_touch(bodies, number, boxes, near[index]):
            counts[row, TOUCHED] = int(boxes[near[index], KIND])


@njit(cache=True)
def _touch_wall(
    row: int, bodies: FloatArray, number: int, counts: IntArray, walls: FloatArray, near: IntArray, nearby: int
) -> None:
    """Notes a wall that a kart touches."""
    for index in range(nearby):
        wall = near[index]
        ends = walls[wall, 0], walls[wall, 1], walls[wall, 2], walls[wall, 3]
        if touches_segment(bodies, number, ends):
            counts[row, TOUCHED] = _WALL


@njit(cache=True)
def _touch_walker(
    row: int, bodies: FloatArray, number: int, counts: IntArray, walkers: FloatArray, first: int, count: int
) -> None:
    """Notes a pedestrian whom a kart touches."""
    for walker in range(first, first + count):
        if (
            distance_to(bodies, number, walkers[walker, WALK_X], walkers[walker, WALK_Y])
            <= walkers[walker, WALK_RADIUS]
        ):
            counts[row, TOUCHED] = _PEDESTRIAN


@njit(cache=True)
def _touch_karts(first: int, bodies: FloatArray, counts: IntArray) -> None:
    """Notes all karts of a lot that touch another one, also parked ones."""
    for number in range(bodies.shape[0]):
        for other in range(number):
            row, second = first + number, first + other
            if counts[row, OUTCOME] == _ABSENT or counts[second, OUTCOME] == _ABSENT:
                continue
            if counts[row, OUTCOME] != _RUNNING and counts[second, OUTCOME] != _RUNNING:
                continue
            if boxes_touch(bodies, number, bodies, other):
                counts[row, TOUCHED] = counts[row, TOUCHED] if counts[row, TOUCHED] != 0 else _KART
                counts[second, TOUCHED] = counts[second, TOUCHED] if counts[second, TOUCHED] != 0 else _KART


@njit(cache=True)
def _judged(
    lot: int,
    row: int,
    torque: float,
    distance: float,
    lots: IntArray,
    rule: FloatArray,
    karts: FloatArray,
    counts: IntArray,
    spots: FloatArray,
) -> int:
    """Outcome of a kart that has touched nothing, `distance` [m] from its spot's centre; see `Rules`."""
    if rule[lot, rules.REVERSING_ENDS] != 0.0 and torque < 0.0:
        return _REVERSED
    if distance > rule[lot, rules.FARTHEST]:
        return _STRAYED
    if distance < rule[lot, rules.RADIUS]:
        error = wrap(karts[row, kart.HEADING] - spots[lot * MAX_SPOTS + counts[row, TARGET], 2])
        wheels = wrap(error + karts[row, kart.STEERING])
        if abs(error) >= rule[lot, rules.ERROR] or abs(wheels) > rule[lot, rules.WHEEL]:
            return _MISALIGNED
        held = counts[row, HELD] >= rule[lot, rules.DWELL_TICKS] * kart.SUBSTEPS
        late = lots[lot, TICK] >= rule[lot, rules.ELAPSED_TICKS]
        if held and late and abs(karts[row, kart.SPEED]) < rule[lot, rules.STANDING]:
            return _PARKED
    return _TIMED_OUT if lots[lot, TICK] >= lots[lot, LIMIT] else _RUNNING


@njit(cache=True)
def alignment_of(karts: FloatArray, row: int, spots: FloatArray, spot: int) -> float:
    """How well a kart is aligned with a spot: 1 exactly, and 1/e at one of the bounds of ISO 16787."""
    error = wrap(karts[row, kart.HEADING] - spots[spot, 2])
    dx, dy = karts[row, kart.X] - spots[spot, 0], karts[row, kart.Y] - spots[spot, 1]
    angle = min(abs(error), math.pi - abs(error)) / rules.ALIGNED_ANGLE_RAD
    side = (dy * spots[spot, 5] - dx * spots[spot, 6]) / rules.ALIGNED_DEVIATION_M
    return math.exp(-angle * angle - side * side)


@njit(cache=True)
def _keep_or_change_target(
    lot: int, row: int, size: int, spots: FloatArray, count: int, karts: FloatArray, counts: IntArray
) -> None:
    """Gives a kart the nearest free spot if another kart is in its own one, unless it is there itself."""
    target = lot * MAX_SPOTS + counts[row, TARGET]
    if counts[row, OUTCOME] != _RUNNING or _inside(spots, target, karts, row):
        return
    if _taken(spots, target, karts, row, size, counts):
        _choose_target(lot, row, size, spots, count, karts, counts, False)


@njit(cache=True)
def _choose_target(
    lot: int,
    row: int,
    size: int,
    spots: FloatArray,
    count: int,
    karts: FloatArray,
    counts: IntArray,
    even_taken: bool,
) -> None:
    """Gives a kart the nearest spot in which nothing stands, nor a kart unless `even_taken`; else it keeps its own."""
    nearest = math.inf
    for index in range(count):
        spot = lot * MAX_SPOTS + index
        distance = math.hypot(spots[spot, 0] - karts[row, kart.X], spots[spot, 1] - karts[row, kart.Y])
        if spots[spot, FREE] == 0.0 or distance >= nearest:
            continue
        if even_taken or not _taken(spots, spot, karts, row, size, counts):
            nearest, counts[row, TARGET], counts[row, HELD] = distance, index, 0


@njit(cache=True)
def _taken(spots: FloatArray, spot: int, karts: FloatArray, row: int, size: int, counts: IntArray) -> bool:
    """Whether the centre of another kart of the lot is in a spot."""
    first = row // size * size
    for other in range(first, first + size):
        if other != row and counts[other, OUTCOME] != _ABSENT and _inside(spots, spot, karts, other):
            return True
    return False


@njit(cache=True)
def _inside(spots: FloatArray, spot: int, karts: FloatArray, row: int) -> bool:
    """Whether the centre of a kart is in a spot."""
    dx, dy = karts[row, kart.X] - spots[spot, 0], karts[row, kart.Y] - spots[spot, 1]
    cos, sin = spots[spot, 5], spots[spot, 6]
    return bool(abs(dx * cos + dy * sin) <= 0.5 * spots[spot, 3] and abs(dy * cos - dx * sin) <= 0.5 * spots[spot, 4])
