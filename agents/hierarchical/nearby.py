"""Nearby: what the exact state of the others says, in numbers of about unit scale; and the distances that matter.

This is what a policy sees in the place of pictures where it is trained without any, and what the autoencoder of
`vision` is taught to tell from a picture.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from agents.experts.surroundings import boxes_on_path, project
from evaluation.agent import Observation
from sumo_networks.arrays import Float32Array, FloatArray
from sumo_networks.sensors.lanes import ATTRIBUTES, POINTS, ROAD
from sumo_networks.sensors.lights import STOPS, YIELDS
from sumo_networks.sensors.path import BEHIND
from sumo_networks.vehicle import VehicleParameters
from sumo_networks.world import ActorKind, LightState

SENSORS = ("objects", "path", "lanes", "lights", "speedometer")
IMPACT_M, EVENT_M = 50.0, 50.0
"""Farther than this, a distance is as good as infinite."""
ACTORS, ACTOR_COLUMNS = 8, 9
STRIPS, STRIP_COLUMNS = 3, 5
JUNCTIONS, JUNCTION_COLUMNS = 2, 6
MARGIN_M = 0.3
LANES_READ = 40
LENGTH_UNIT_M, WIDTH_UNIT_M, SPEED_UNIT_M_S = 10.0, 3.0, 15.0
_RED, _YELLOW, _GREEN = int(LightState.RED), int(LightState.YELLOW), int(LightState.GREEN)
_PEDESTRIAN = int(ActorKind.PEDESTRIAN)
_ALIGNED = math.cos(math.radians(30.0))
_LENGTH_M, _WIDTH_M = VehicleParameters().length, VehicleParameters().width


def distances(observation: Observation) -> Float32Array:
    """(2,) metres from the ego's front to the first actor in its way, and to the next event, at most 50 each.

    In its way is who reaches into the strip along the path that the ego's body covers, 0.3 m wider on both sides. An
    event is a junction or a light: its stop line, and 0 while the front is inside.

    Args:
        observation: With `objects`, `path` and `lights`.
    """
    path = observation["path"].astype(np.float64)
    boxes = boxes_on_path(observation["objects"], path)
    return _distances(boxes, _start(path), observation["lights"])


def actors_near(objects: Float32Array) -> Float32Array:
    """(8, 9) the nearest within 50 m, nearest first, in the ego's frame; zeros where there is nobody.

    Columns: 1 for somebody, x [50 m], y [50 m], cosine and sine of the heading, speed [15 m/s], length [10 m], width
    [3 m], on foot (0 or 1).

    Args:
        objects: (48, 8), see `sensors.objects`.
    """
    out = np.zeros((ACTORS, ACTOR_COLUMNS), dtype=np.float32)
    _fill_actors(objects, out)
    return out


def strips(observation: Observation) -> Float32Array:
    """(3, 5) the strip along the path, the one a lane's width to its left, and the one to its right.

    Columns: 1 where it is a lane of the road's own direction, distance from the ego's front to the first body ahead
    [50 m], its speed along the path [15 m/s], distance from the ego's rear to the first body behind [50 m], its speed.
    Who is beside the ego is at distance 0 both ways. Nobody within 50 m: distance 1 and speed 0.

    Args:
        observation: With `objects`, `path` and `lanes`.
    """
    path = observation["path"].astype(np.float64)
    boxes = boxes_on_path(observation["objects"], path)
    return _strips(boxes, observation["objects"], path, observation["lanes"], _start(path))


def junctions(lights: Float32Array) -> Float32Array:
    """(2, 6) the next two junctions: distance [50 m, at most 1], red, yellow, green, to yield, to stop (0 or 1).

    Args:
        lights: (4, 4), see `sensors.lights`.
    """
    out = np.zeros((JUNCTIONS, JUNCTION_COLUMNS), dtype=np.float32)
    near = lights[:JUNCTIONS]
    out[:, 0] = np.clip(near[:, 0] / EVENT_M, -1.0, 1.0)
    for column, value in ((1, _RED), (2, _YELLOW), (3, _GREEN)):
        out[:, column] = near[:, 2] == value
    out[:, 4], out[:, 5] = near[:, 3] == YIELDS, near[:, 3] == STOPS
    return out


def _start(path: FloatArray) -> float:
    """Where the ego's centre is along a path whose kernels count from its nearest whole metre, m."""
    x, y, heading = path[BEHIND, :3]
    return float(-x * math.cos(heading) - y * math.sin(heading))


@njit(cache=True)
def _distances(boxes: FloatArray, start: float, lights: Float32Array) -> Float32Array:
    half_length, reach = 0.5 * _LENGTH_M, 0.5 * _WIDTH_M + MARGIN_M
    impact = IMPACT_M
    for row in boxes:
        if row[0] == row[1] or row[1] - start < half_length or row[2] > reach or row[3] < -reach:
            continue
        impact = min(impact, max(row[0] - start - half_length, 0.0))
    event = min(max(float(lights[0, 0]), 0.0), EVENT_M)
    return np.array([impact, event], dtype=np.float32)


@njit(cache=True)
def _fill_actors(objects: Float32Array, out: Float32Array) -> None:
    for row in range(out.shape[0]):
        kind, x, y, heading, speed, length, width, _ = objects[row]
        if kind < 0 or math.hypot(x, y) > IMPACT_M:
            break
        out[row, 0], out[row, 1], out[row, 2] = 1.0, x / IMPACT_M, y / IMPACT_M
        out[row, 3], out[row, 4], out[row, 5] = math.cos(heading), math.sin(heading), speed / SPEED_UNIT_M_S
        out[row, 6], out[row, 7], out[row, 8] = length / LENGTH_UNIT_M, width / WIDTH_UNIT_M, kind == _PEDESTRIAN


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
