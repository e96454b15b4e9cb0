"""Kernels over all lots: beginning, one tick of 0.1 s, observations."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.geometry import box_overlaps, wrap
from dohyo.sumo_networks.parking import kart, radar, rules
from dohyo.sumo_networks.parking.arrays import Episodes, Scenery
from dohyo.sumo_networks.parking.contact import box_touches_disc, box_touches_segment, distance_to_box
from dohyo.sumo_networks.parking.observation import write_radar, write_state

_RUNNING, _PARKED, _COLLIDED, _TIMED_OUT, _REVERSED, _MISALIGNED, _STRAYED, _ABSENT = range(8)
_WALL, _CAR, _KART, _PEDESTRIAN = 1, 2, 3, 4
WAITS_M: Final = 0.6
"""A pedestrian waits while the next step would lead nearer than this to a kart."""


@njit(cache=True)
def begin(lot: int, starts: FloatArray, scenery: Scenery, episodes: Episodes) -> None:
    """Begins the episode of a lot whose scenery is drawn, with (K', 3) karts at rest; the others are absent."""
    for number in range(episodes.karts.shape[1]):
        body = episodes.karts[lot, number]
        body[:] = 0.0
        there = number < starts.shape[0]
        if there:
            body[kart.X], body[kart.Y], body[kart.HEADING] = (
                starts[number, 0],
                starts[number, 1],
                wrap(starts[number, 2]),
            )
        episodes.outcome[lot, number] = _RUNNING if there else _ABSENT
        episodes.held[lot, number] = episodes.touched[lot, number] = episodes.shunts[lot, number] = 0
        episodes.gear[lot, number] = episodes.ended_at[lot, number] = 0
        episodes.driven_m[lot, number] = 0.0
    episodes.walked_m[lot, :] = 0.0
    episodes.tick[lot] = 0
    for number in range(episodes.karts.shape[1]):
        episodes.target[lot, number] = 0
        if episodes.outcome[lot, number] == _RUNNING:
            episodes.target[lot, number] = max(_nearest_free(lot, number, scenery, episodes), 0)


@njit(cache=True)
def advance(scenery: Scenery, episodes: Episodes, actions: FloatArray, rewards: FloatArray) -> None:
    """Advances every lot in which a kart's episode runs by one tick.

    Args:
        scenery: Of N lots.
        episodes: Their episodes, which are changed.
        actions: (N, K, 3) shares of motor torque, steering angle, brake torque, in [-1, 1].
        rewards: (N, K) to write to; 0 where no episode ran.
    """
    lots, karts = episodes.outcome.shape
    boxes, before = np.empty((karts, 5)), np.empty(karts)
    running = np.empty(karts, np.bool_)
    for lot in range(lots):
        any_runs = False
        for number in range(karts):
            running[number] = episodes.outcome[lot, number] == _RUNNING
            any_runs |= running[number]
            rewards[lot, number] = 0.0
            if episodes.outcome[lot, number] != _ABSENT:
                _write_box(episodes.karts[lot, number], boxes[number])
                before[number] = _spot_distance(lot, number, scenery, episodes)
        if not any_runs:
            continue
        episodes.tick[lot] += 1
        _drive_lot(lot, scenery, episodes, actions, boxes)
        for number in range(karts):
            if running[number]:
                _judge(lot, number, scenery, episodes, actions[lot, number, 0])
                reward = _reward(episodes.outcome[lot, number])
                if episodes.rules[lot, rules.PROGRESS] != 0.0:
                    nearer = before[number] - _spot_distance(lot, number, scenery, episodes)
                    reward += episodes.rules[lot, rules.PROGRESS] * nearer
                rewards[lot, number] = reward
        for number in range(karts):
            if episodes.outcome[lot, number] == _RUNNING:
                _keep_or_change_target(lot, number, scenery, episodes)


@njit(cache=True)
def _drive_lot(
    lot: int,
    scenery: Scenery,
    episodes: Episodes,
    actions: FloatArray,
    boxes: FloatArray,
) -> None:
    """Moves pedestrians and karts of a lot for one tick; karts that touch something have collided."""
    karts = boxes.shape[0]
    for _ in range(kart.SUBSTEPS):
        _walk(lot, scenery, episodes, boxes)
        for number in range(karts):
            if episodes.outcome[lot, number] != _RUNNING:
                continue
            body, action = episodes.karts[lot, number], actions[lot, number]
            kart.drive(body, action[0], action[1], action[2])
            _write_box(body, boxes[number])
            _count_motion(lot, number, body[kart.SPEED], episodes)
            if _spot_distance(lot, number, scenery, episodes) < episodes.rules[lot, rules.RADIUS]:
                episodes.held[lot, number] += 1
            else:
                episodes.held[lot, number] = 0
        for number in range(karts):
            if episodes.outcome[lot, number] != _ABSENT:
                touched = _touched(lot, number, scenery, episodes, boxes)
                if touched != 0 and episodes.touched[lot, number] == 0:
                    episodes.touched[lot, number] = touched
        for number in range(karts):
            if episodes.outcome[lot, number] == _RUNNING and episodes.touched[lot, number] != 0:
                episodes.outcome[lot, number] = _COLLIDED


@njit(cache=True)
def _write_box(body: FloatArray, box: FloatArray) -> None:
    box[0], box[1], box[2] = body[kart.X], body[kart.Y], body[kart.HEADING]
    box[3], box[4] = kart.LENGTH_M, kart.WIDTH_M


@njit(cache=True)
def _spot_distance(lot: int, number: int, scenery: Scenery, episodes: Episodes) -> float:
    """Distance of a kart's centre to the centre of its spot, m."""
    spot, body = scenery.spots[lot, episodes.target[lot, number]], episodes.karts[lot, number]
    return math.hypot(spot[0] - body[kart.X], spot[1] - body[kart.Y])


@njit(cache=True)
def _count_motion(lot: int, number: int, speed: float, episodes: Episodes) -> None:
    """Counts distance and changes of direction."""
    episodes.driven_m[lot, number] += abs(speed) * kart.SUBSTEP_S
    if speed == 0.0:
        return
    gear = 1 if speed > 0.0 else -1
    if gear == -episodes.gear[lot, number]:
        episodes.shunts[lot, number] += 1
    episodes.gear[lot, number] = gear


@njit(cache=True)
def walker_place(row: FloatArray, walked: float) -> tuple[float, float]:
    """Place of a pedestrian (6,) that has walked a way, m."""
    length = math.hypot(row[2] - row[0], row[3] - row[1])
    if length == 0.0:
        return row[0], row[1]
    share = walked % (2.0 * length) / length
    share = 2.0 - share if share > 1.0 else share
    return row[0] + share * (row[2] - row[0]), row[1] + share * (row[3] - row[1])


@njit(cache=True)
def _walk(lot: int, scenery: Scenery, episodes: Episodes, boxes: FloatArray) -> None:
    """Moves the pedestrians whose next step leads to no kart."""
    for walker in range(scenery.walker_count[lot]):
        row = scenery.walkers[lot, walker]
        walked = episodes.walked_m[lot, walker] + row[4] * kart.SUBSTEP_S
        x, y = walker_place(row, walked)
        old_x, old_y = walker_place(row, episodes.walked_m[lot, walker])
        waits = False
        for number in range(boxes.shape[0]):
            if episodes.outcome[lot, number] == _ABSENT:
                continue
            distance = distance_to_box(boxes[number], x, y)
            if distance < row[5] + WAITS_M and distance < distance_to_box(boxes[number], old_x, old_y):
                waits = True
        if not waits:
            episodes.walked_m[lot, walker] = walked


@njit(cache=True)
def _touched(lot: int, number: int, scenery: Scenery, episodes: Episodes, boxes: FloatArray) -> int:
    """Kind of what a kart touches; 0: nothing."""
    box = boxes[number]
    for other in range(scenery.box_count[lot]):
        packed = scenery.packed[lot, other]
        dx, dy, reach = packed[0] - box[0], packed[1] - box[1], packed[6] + kart.RADIUS_M
        if dx * dx + dy * dy <= reach * reach and box_overlaps(box, scenery.boxes[lot, other]):
            return int(scenery.box_kind[lot, other])
    for other in range(boxes.shape[0]):
        if other == number or episodes.outcome[lot, other] == _ABSENT:
            continue
        dx, dy = boxes[other, 0] - box[0], boxes[other, 1] - box[1]
        if dx * dx + dy * dy <= 4.0 * kart.RADIUS_M**2 and box_overlaps(box, boxes[other]):
            return _KART
    for walker in range(scenery.walker_count[lot]):
        row = scenery.walkers[lot, walker]
        x, y = walker_place(row, episodes.walked_m[lot, walker])
        if box_touches_disc(box, x, y, row[5]):
            return _PEDESTRIAN
    for wall in range(scenery.wall_count[lot]):
        if _may_touch(box, scenery.walls[lot, wall]) and box_touches_segment(box, scenery.walls[lot, wall]):
            return _WALL
    return 0


@njit(cache=True)
def _may_touch(box: FloatArray, wall: FloatArray) -> bool:
    """Whether the circle around a kart may reach a wall."""
    reach = kart.RADIUS_M
    return not (
        box[0] + reach < min(wall[0], wall[2])
        or box[0] - reach > max(wall[0], wall[2])
        or box[1] + reach < min(wall[1], wall[3])
        or box[1] - reach > max(wall[1], wall[3])
    )


@njit(cache=True)
def _judge(lot: int, number: int, scenery: Scenery, episodes: Episodes, torque: float) -> None:
    """Ends a kart's episode where the rules say so; see `Rules`."""
    row, body = episodes.rules[lot], episodes.karts[lot, number]
    outcome = episodes.outcome[lot, number]
    if outcome == _RUNNING:
        distance = _spot_distance(lot, number, scenery, episodes)
        if row[rules.REVERSING_ENDS] != 0.0 and torque < 0.0:
            outcome = _REVERSED
        elif distance < row[rules.RADIUS]:
            error = wrap(body[kart.HEADING] - scenery.spots[lot, episodes.target[lot, number], 2])
            wheels = wrap(error + body[kart.STEERING])
            if abs(error) >= row[rules.ERROR] or abs(wheels) > row[rules.WHEEL]:
                outcome = _MISALIGNED
            elif (
                episodes.held[lot, number] >= row[rules.DWELL_TICKS] * kart.SUBSTEPS
                and episodes.tick[lot] >= row[rules.ELAPSED_TICKS]
                and abs(body[kart.SPEED]) < row[rules.STANDING]
            ):
                outcome = _PARKED
        elif distance > row[rules.FARTHEST]:
            outcome = _STRAYED
        if outcome == _RUNNING and episodes.tick[lot] >= scenery.ticks[lot]:
            outcome = _TIMED_OUT
    if outcome != _RUNNING:
        episodes.outcome[lot, number] = outcome
        episodes.ended_at[lot, number] = episodes.tick[lot]
        body[kart.SPEED] = 0.0


@njit(cache=True)
def _reward(outcome: int) -> float:
    if outcome == _RUNNING:
        return 0.0
    return 1.0 if outcome == _PARKED else -1.0


@njit(cache=True)
def _keep_or_change_target(lot: int, number: int, scenery: Scenery, episodes: Episodes) -> None:
    """Gives a kart the nearest free spot if another kart is in its own one."""
    target = episodes.target[lot, number]
    if _inside(lot, target, number, scenery, episodes) or not _taken(lot, target, number, scenery, episodes):
        return
    other = _nearest_free(lot, number, scenery, episodes)
    if other >= 0:
        episodes.target[lot, number] = other
        episodes.held[lot, number] = 0


@njit(cache=True)
def _nearest_free(lot: int, number: int, scenery: Scenery, episodes: Episodes) -> int:
    """Nearest spot in which nothing stands and no other kart is; -1: none."""
    best, nearest, body = -1, math.inf, episodes.karts[lot, number]
    for spot in range(scenery.spot_count[lot]):
        if not scenery.spot_free[lot, spot]:
            continue
        row = scenery.spots[lot, spot]
        distance = math.hypot(row[0] - body[kart.X], row[1] - body[kart.Y])
        if distance < nearest and not _taken(lot, spot, number, scenery, episodes):
            best, nearest = spot, distance
    return best


@njit(cache=True)
def _taken(lot: int, spot: int, number: int, scenery: Scenery, episodes: Episodes) -> bool:
    """Whether the centre of another kart is in a spot."""
    for other in range(episodes.outcome.shape[1]):
        if other == number or episodes.outcome[lot, other] == _ABSENT:
            continue
        if _inside(lot, spot, other, scenery, episodes):
            return True
    return False


@njit(cache=True)
def _inside(lot: int, spot: int, number: int, scenery: Scenery, episodes: Episodes) -> bool:
    body = episodes.karts[lot, number]
    return distance_to_box(scenery.spots[lot, spot], body[kart.X], body[kart.Y]) == 0.0


@njit(cache=True)
def observe(scenery: Scenery, episodes: Episodes, which: BoolArray, out: Float32Array) -> None:
    """Writes observations.

    Args:
        scenery: Of N lots.
        episodes: Their episodes.
        which: (N, K) karts to write.
        out: (N, K, 64) observations.
    """
    distance, kind = np.empty(radar.RAYS), np.empty(radar.RAYS, np.int64)
    lots, karts = which.shape
    box, packed = np.empty(5), np.empty(radar.PACKED)
    for lot in range(lots):
        for number in range(karts):
            if not which[lot, number]:
                continue
            body, row = episodes.karts[lot, number], out[lot, number]
            held = episodes.held[lot, number] * kart.SUBSTEP_S
            elapsed = episodes.tick[lot] / scenery.ticks[lot]
            write_state(body, scenery.spots[lot, episodes.target[lot, number]], held, elapsed, row)
            scan(lot, number, scenery, episodes, box, packed, distance, kind)
            write_radar(distance, kind, row)


@njit(cache=True)
def scan(
    lot: int,
    number: int,
    scenery: Scenery,
    episodes: Episodes,
    box: FloatArray,
    packed: FloatArray,
    distance: FloatArray,
    kind: IntArray,
) -> None:
    """Writes a kart's (9,) radar distances [m] and kinds; box (5,) and packed (7,) are room to work in."""
    body = episodes.karts[lot, number]
    x, y = body[kart.X], body[kart.Y]
    cos, sin = math.cos(body[kart.HEADING]), math.sin(body[kart.HEADING])
    radar.clear(distance, kind)
    for wall in range(scenery.wall_count[lot]):
        radar.meet_wall(x, y, cos, sin, scenery.walls[lot, wall], distance, kind)
    for other in range(scenery.box_count[lot]):
        radar.meet_box(x, y, cos, sin, scenery.packed[lot, other], scenery.box_kind[lot, other], distance, kind)
    for other in range(episodes.outcome.shape[1]):
        if other != number and episodes.outcome[lot, other] != _ABSENT:
            _write_box(episodes.karts[lot, other], box)
            radar.pack_box(box, packed)
            radar.meet_box(x, y, cos, sin, packed, _KART, distance, kind)
    for walker in range(scenery.walker_count[lot]):
        row = scenery.walkers[lot, walker]
        walker_x, walker_y = walker_place(row, episodes.walked_m[lot, walker])
        radar.meet_disc(x, y, cos, sin, (walker_x, walker_y, row[5]), _PEDESTRIAN, distance, kind)
