"""Surroundings: actors and lanes in the frame of the route, for rules that move the ego sideways."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit

from dohyo.agents.planning.path_behind import FURTHER_M, continued
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.sensors import objects
from dohyo.sumo_networks.sensors import path as paths
from dohyo.sumo_networks.sensors.lanes import ATTRIBUTES, COLUMNS, POINTS, ROAD, ROWS
from dohyo.sumo_networks.sensors.path import BEHIND
from dohyo.sumo_networks.world import ActorKind

ALIGNED = math.cos(math.radians(30.0))
COVERED_M = 8.0
STANDS = 0.3
_ZERO = BEHIND + FURTHER_M


@dataclass(frozen=True, slots=True)
class Neighbour:
    """Actor in the frame of the route: s along it from the ego's centre, d to the left of it, m.

    Attributes:
        kind: `ActorKind`.
        key: Stable while the actor exists.
        s_low: Rear end along the route, m.
        s_high: Front end along the route, m.
        d_low: Right edge, m.
        d_high: Left edge, m.
        speed: In any direction, m/s.
        along: Share of its heading along the route: 1 the ego's direction, -1 oncoming.
        across: Share of its heading to the left of the route.
    """

    kind: int
    key: int
    s_low: float
    s_high: float
    d_low: float
    d_high: float
    speed: float
    along: float
    across: float

    @property
    def oncoming(self) -> bool:
        """Whether it drives against the route, within 30 degrees."""
        return self.opposes and self.speed > 1.0

    @property
    def opposes(self) -> bool:
        """Whether it heads against the route, within 30 degrees, moving or standing."""
        return self.along < -ALIGNED

    @property
    def stands(self) -> bool:
        """Whether it does not move."""
        return self.speed < STANDS

    def within(self, low: float, high: float) -> bool:
        """Whether its box reaches into a strip beside the route, m."""
        return self.d_high > low and self.d_low < high


@dataclass(frozen=True, slots=True)
class LaneBeside:
    """A lane beside the route's.

    Attributes:
        d: Middle of the lane, m to the left of the route.
        width: m.
        oncoming: Whether its direction is opposite.
    """

    d: float
    width: float
    oncoming: bool


class Surroundings:
    """One observation in the frame of the route.

    Attributes:
        neighbours: All actors in sight, nearest first, including pedestrians.
        lane_width: Of the ego's lane, m.
    """

    def __init__(self, observation: Observation) -> None:
        self._lanes, path = observation["lanes"], observation["path"].astype(np.float64)
        self._path = continued(path, self._lanes)
        # The path's places count from its whole metre nearest to the ego.
        _, self._ego_s, _ = project(0.0, 0.0, self._path, _ZERO)
        rows = boxes_on_path(observation["objects"], self._path, _ZERO)
        rows[:, :2] -= self._ego_s
        self.lane_width = float(path[BEHIND, 5])
        self.neighbours = tuple(
            Neighbour(int(seen[0]), int(seen[7]), row[0], row[1], row[2], row[3], float(seen[4]), row[4], row[5])
            for seen, row in zip(observation["objects"], rows.tolist(), strict=True)
            if seen[0] >= 0
        )

    def driving(self) -> Iterator[Neighbour]:
        """All actors except pedestrians."""
        return (one for one in self.neighbours if one.kind != ActorKind.PEDESTRIAN)

    def lanes_beside(self, first: float, last: float) -> list[LaneBeside]:
        """Lanes next to the route's that run beside it over a whole stretch [m from the ego's centre]."""
        rows = self._lanes[(self._lanes[:, 0] >= 0) & (self._lanes[:, 2] == ROAD)]
        points = rows[:, ATTRIBUTES:].reshape(len(rows), POINTS, 2).astype(np.float64)
        found = _points_on_path(points, self._path, _ZERO)
        found[:, 0] -= self._ego_s
        widths = np.repeat(rows[:, 3], points.shape[1])
        out = []
        for sign, oncoming in ((1.0, False), (-1.0, False), (1.0, True)):
            d, along = found[:, 1] * sign, found[:, 2] * (-1.0 if oncoming else 1.0)
            near = (d > 0.6 * self.lane_width) & (d < 1.6 * self.lane_width) & (along > ALIGNED)
            near &= (found[:, 0] > first - COVERED_M) & (found[:, 0] < last + COVERED_M)
            s = np.sort(found[near, 0])
            stops = np.concatenate([[first - COVERED_M / 2], s, [last + COVERED_M / 2]])
            if len(s) and float(np.diff(stops).max()) < COVERED_M:
                width = float(np.median(widths[near]))
                out.append(LaneBeside(sign * float(np.median(d[near])), width, oncoming))
        return out


def warm_up() -> None:
    """Compiles the kernels, so that no decision waits for them."""
    nothing = {
        "path": np.zeros((paths.POINTS, 6), dtype=np.float32),
        "lanes": np.zeros((ROWS, COLUMNS), dtype=np.float32),
        "objects": np.full((objects.ROWS, objects.COLUMNS), -1.0, dtype=np.float32),
    }
    Surroundings(nothing).lanes_beside(0.0, 1.0)


@njit(cache=True)
def ran_into_from_behind(x: float, y: float, heading: float, length: float, half_length: float) -> bool:
    """Whether an actor (pose in the ego's frame) touches the ego's rear. Waiting for it would never end."""
    return -half_length - 0.5 * length < x < 0.0 and abs(y) < 1.0 and abs(heading) < 0.5


@njit(cache=True)
def project(x: float, y: float, path: FloatArray, zero: int = BEHIND) -> tuple[int, float, float]:
    """Row of the path nearest to a point, metres along it from row `zero`, and to the left of it."""
    i, least = 0, math.inf
    for j in range(path.shape[0]):
        d = (path[j, 0] - x) ** 2 + (path[j, 1] - y) ** 2
        # Before the start the first point repeats: its last copy is the true one.
        if d < least or (d == least and j <= zero):
            i, least = j, d
    dx, dy = x - path[i, 0], y - path[i, 1]
    cos, sin = math.cos(path[i, 2]), math.sin(path[i, 2])
    return i, i - zero + dx * cos + dy * sin, dy * cos - dx * sin


@njit(cache=True)
def boxes_on_path(objects: Float32Array, path: FloatArray, zero: int = BEHIND) -> FloatArray:
    """(48, 6) lowest and highest s from row `zero` and d [m] of each box, cosine and sine of its heading."""
    out = np.zeros((objects.shape[0], 6))
    for k in range(objects.shape[0]):
        if objects[k, 0] < 0:
            break
        x, y, heading, length, width = objects[k, 1], objects[k, 2], objects[k, 3], objects[k, 5], objects[k, 6]
        cos, sin = math.cos(heading), math.sin(heading)
        out[k, 0], out[k, 2] = math.inf, math.inf
        out[k, 1], out[k, 3] = -math.inf, -math.inf
        for a in (-0.5, 0.0, 0.5):
            for b in (-0.5, 0.5):
                px, py = x + a * length * cos - b * width * sin, y + a * length * sin + b * width * cos
                _, s, d = project(px, py, path, zero)
                out[k, 0], out[k, 1] = min(out[k, 0], s), max(out[k, 1], s)
                out[k, 2], out[k, 3] = min(out[k, 2], d), max(out[k, 3], d)
        i, _, _ = project(x, y, path, zero)
        out[k, 4], out[k, 5] = math.cos(heading - path[i, 2]), math.sin(heading - path[i, 2])
    return out


@njit(cache=True)
def _points_on_path(lines: FloatArray, path: FloatArray, zero: int) -> FloatArray:
    """(N * P, 3) s, d [m] of each point of N polylines, and the cosine of the polyline's heading to the path's."""
    count = lines.shape[1]
    out = np.empty((lines.shape[0] * count, 3))
    for k in range(lines.shape[0]):
        for p in range(count):
            i, s, d = project(lines[k, p, 0], lines[k, p, 1], path, zero)
            a = min(p, count - 2)
            heading = math.atan2(lines[k, a + 1, 1] - lines[k, a, 1], lines[k, a + 1, 0] - lines[k, a, 0])
            out[k * count + p] = s, d, math.cos(heading - path[i, 2])
    return out
