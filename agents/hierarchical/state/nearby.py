"""Nearby: exact state of the others in numbers of about unit scale, and distances to impact and event.

Policies without pictures see these numbers. The autoencoder of `vision` learns to predict the distances from a picture.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dohyo.agents.planning.surroundings import boxes_on_path, project
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.sensors.lanes import ATTRIBUTES, POINTS, ROAD
from dohyo.sumo_networks.sensors.path import BEHIND
from dohyo.sumo_networks.world import ActorKind, LightState

SENSORS = ("objects", "path", "lanes", "junctions_ahead", "conflicts", "speedometer")
IMPACT_M, EVENT_M = 50.0, 50.0
"""Distance that stands for all greater ones, m."""
ACTORS, ACTOR_COLUMNS = 8, 9
ASIDE_M = 8.0
STRIPS, STRIP_COLUMNS = 3, 5
JUNCTIONS, JUNCTION_COLUMNS = 2, 7
CROSSINGS, CROSSING_COLUMNS = 6, 9
SOON_S, SLOWEST_M_S = 8.0, 0.5
SHORTEST_M, HARDEST_M_S2 = 0.1, 8.0
MARGIN_M = 0.3
LANES_READ = 40
LENGTH_UNIT_M, SPEED_UNIT_M_S = 10.0, 15.0
_RED, _YELLOW, _GREEN = int(LightState.RED), int(LightState.YELLOW), int(LightState.GREEN)
_PEDESTRIAN = int(ActorKind.PEDESTRIAN)
_ALIGNED = math.cos(math.radians(30.0))
_LENGTH_M, _WIDTH_M = VehicleParameters().length, VehicleParameters().width


def distances(observation: Observation) -> Float32Array:
    """(2,) metres from the ego's front to the first actor in its way, and to the next event, at most 50 each.

    An actor is in its way if it reaches into the strip that the ego's body covers along the path, plus 0.3 m on each
    side. An event is a junction or a light: its stop line, and 0 while the front is inside.

    Args:
        observation: With `objects`, `path` and `junctions_ahead`.
    """
    path = observation["path"].astype(np.float64)
    boxes = boxes_on_path(observation["objects"], path)
    return _distances(boxes, _start(path), observation["junctions_ahead"])


def actors_near(observation: Observation) -> Float32Array:
    """(8, 9) nearest actors along the path, beside the ego's front or ahead of it; zeros for padding.

    Actors within 8 m to the side and 50 m ahead count. Columns: 1 for an actor, distance from the
    ego's front (see `root`), right and left side of the body [8 m to the left of the path, from -1 to 1], cosine and
    sine of its heading to the path's, speed [15 m/s], length [10 m], on foot (0 or 1).

    Args:
        observation: With `objects` and `path`.
    """
    path = observation["path"].astype(np.float64)
    boxes, objects = boxes_on_path(observation["objects"], path), observation["objects"]
    gap = np.maximum(boxes[:, 0] - _start(path) - 0.5 * _LENGTH_M, 0.0)
    near = (boxes[:, 1] > boxes[:, 0]) & (boxes[:, 1] - _start(path) > -0.5 * _LENGTH_M) & (gap < IMPACT_M)
    near &= (boxes[:, 2] < ASIDE_M) & (boxes[:, 3] > -ASIDE_M)
    rows = np.flatnonzero(near)
    rows = rows[np.argsort(gap[rows], kind="stable")][:ACTORS]
    out = np.zeros((ACTORS, ACTOR_COLUMNS), dtype=np.float32)
    of, what = boxes[rows], objects[rows]
    sides = np.clip(of[:, 2:4] / ASIDE_M, -1.0, 1.0).T
    speed, length = what[:, 4] / SPEED_UNIT_M_S, what[:, 5] / LENGTH_UNIT_M
    columns = (np.ones(len(rows)), root(gap[rows] / IMPACT_M), *sides, of[:, 4], of[:, 5])
    out[: len(rows)] = np.stack([*columns, speed, length, what[:, 0] == _PEDESTRIAN], axis=1)
    return out


def strips(observation: Observation) -> Float32Array:
    """(3, 5) strips along the path, a lane's width to its left, and to its right.

    Columns: 1 for a lane of the road's own direction, distance from the ego's front to the first body ahead
    (see `root`), its speed along the path [15 m/s], distance from the ego's rear to the first body behind, its speed.
    An actor beside the ego is at distance 0 in both directions. Without one within 50 m: distance 1 and speed 0.

    Args:
        observation: With `objects`, `path` and `lanes`.
    """
    path = observation["path"].astype(np.float64)
    boxes = boxes_on_path(observation["objects"], path)
    out = _strips(boxes, observation["objects"], path, observation["lanes"], _start(path))
    out[:, (1, 3)] = root(out[:, (1, 3)])
    return out


def junctions(observation: Observation) -> Float32Array:
    """(2, 7) the next two junctions, and whether the ego could still stop before them.

    Columns: distance (see `root`), red, yellow, green, to yield, to stop (0 or 1), and the braking that stops there
    [8 m/s^2, at most 1].

    Args:
        observation: With `junctions_ahead` and `speedometer`.
    """
    out = np.zeros((JUNCTIONS, JUNCTION_COLUMNS), dtype=np.float32)
    near, speed = observation["junctions_ahead"][:JUNCTIONS], float(observation["speedometer"][0])
    out[:, 0] = root(near[:, 0] / EVENT_M)
    for column, value in ((1, _RED), (2, _YELLOW), (3, _GREEN)):
        out[:, column] = near[:, 2] == value
    out[:, 4], out[:, 5] = near[:, 3] == RightOfWay.YIELD, near[:, 3] == RightOfWay.STOP
    out[:, 6] = np.minimum(0.5 * speed**2 / np.maximum(near[:, 0], SHORTEST_M) / HARDEST_M_S2, 1.0)
    return out


def crossings(conflicts: Float32Array) -> Float32Array:
    """(6, 9) actors that will cross or join the ego's path, nearest first; zeros for padding.

    Columns: 1 for an actor, distance to where the paths meet and to where the ego's rear has left (see `root`), the
    other's distance to there, the times until it enters and has left [8 s, from -1 to 1], its speed [15 m/s], right of
    way (1 the ego must give way, -1 the other must), on foot (0 or 1).

    Args:
        conflicts: (16, 8), see `sensors.conflicts`.
    """
    out = np.zeros((CROSSINGS, CROSSING_COLUMNS), dtype=np.float32)
    ahead = conflicts[(conflicts[:, 6] >= 0) & (conflicts[:, 1] > 0.0) & (conflicts[:, 3] > 0.0)][:CROSSINGS]
    enter, leave, other_enter, other_leave, speed, priority, kind = ahead[:, :7].T
    seconds = np.stack([other_enter, other_leave]) / np.maximum(speed, SLOWEST_M_S)
    columns = (
        *(np.ones_like(speed), *root(np.stack([enter, leave, other_enter]) / IMPACT_M)),
        *(*np.clip(seconds / SOON_S, -1.0, 1.0), speed / SPEED_UNIT_M_S, priority, kind == _PEDESTRIAN),
    )
    out[: len(ahead)] = np.stack(columns, axis=1)
    return out


def root(distance: FloatArray | Float32Array) -> Float32Array:
    """Root of a distance [50 m], with its sign, from -1 to 1: proportional to the speed that can be braked away.

    Half a metre before a line is then a tenth of the range, not a hundredth.
    """
    near = np.clip(distance, -1.0, 1.0)
    out: Float32Array = (np.sign(near) * np.sqrt(np.abs(near))).astype(np.float32)
    return out


def _start(path: FloatArray) -> float:
    """Position of the ego's centre along a path whose kernels count from the nearest whole metre, m."""
    x, y, heading = path[BEHIND, :3]
    return float(-x * math.cos(heading) - y * math.sin(heading))


@njit(cache=True)
def _distances(boxes: FloatArray, start: float, junctions: Float32Array) -> Float32Array:
    half_length, reach = 0.5 * _LENGTH_M, 0.5 * _WIDTH_M + MARGIN_M
    impact = IMPACT_M
    for row in boxes:
        if row[0] == row[1] or row[1] - start < half_length or row[2] > reach or row[3] < -reach:
            continue
        impact = min(impact, max(row[0] - start - half_length, 0.0))
    event = min(max(float(junctions[0, 0]), 0.0), EVENT_M)
    return np.array([impact, event], dtype=np.float32)


@njit(cache=True)
def _strips(
    boxes: FloatArray, objects: Float32Array, path: FloatArray, lanes: Float32Array, start: float
) -> Float32Array:
    half_length, reach, lane = 0.5 * _LENGTH_M, 0.5 * _WIDTH_M + MARGIN_M, path[BEHIND, 5]
    out = np.zeros((STRIPS, STRIP_COLUMNS), dtype=np.float32)
    out[:, 1], out[:, 3], out[0, 0] = 1.0, 1.0, 1.0
    for strip in range(STRIPS):
        middle = 0.0 if strip == 0 else lane if strip == 1 else -lane
        for row in range(boxes.shape[0]):
            if objects[row, 0] < 0:
                break
            if boxes[row, 2] > middle + reach or boxes[row, 3] < middle - reach:
                continue
            speed = objects[row, 4] * boxes[row, 4] / SPEED_UNIT_M_S
            ahead = max(boxes[row, 0] - start - half_length, 0.0) / IMPACT_M
            behind = max(start - half_length - boxes[row, 1], 0.0) / IMPACT_M
            if boxes[row, 1] - start > -half_length and ahead < out[strip, 1]:
                out[strip, 1], out[strip, 2] = ahead, speed
            if boxes[row, 0] - start < half_length and behind < out[strip, 3]:
                out[strip, 3], out[strip, 4] = behind, speed
    _mark_lanes(out, path, lanes, lane)
    return out


@njit(cache=True)
def _mark_lanes(out: Float32Array, path: FloatArray, lanes: Float32Array, lane: float) -> None:
    """Marks the strips beside the path that are lanes of its direction where the ego is."""
    for row in range(min(lanes.shape[0], LANES_READ)):
        if lanes[row, 0] < 0:
            break
        if lanes[row, 2] != ROAD:
            continue
        for p in range(POINTS - 1):
            x, y = lanes[row, ATTRIBUTES + 2 * p], lanes[row, ATTRIBUTES + 2 * p + 1]
            if math.hypot(x, y) > 10.0:
                continue
            i, s, d = project(float(x), float(y), path)
            onward = lanes[row, ATTRIBUTES + 2 * p + 2] - x, lanes[row, ATTRIBUTES + 2 * p + 3] - y
            along = math.cos(math.atan2(onward[1], onward[0]) - path[i, 2])
            if abs(s) < 8.0 and along > _ALIGNED and 0.6 * lane < abs(d) < 1.6 * lane:
                out[1 if d > 0.0 else 2, 0] = 1.0
