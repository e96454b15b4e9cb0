"""Scene: input of planners and predictors, as arrays built from observations alone.

Everything is in the ego's frame of the present tick: origin at the centre of its box, x forward, y left. A
`SceneBuilder` keeps what a single observation cannot hold: the poses of the last 1.5 s, and whether the ego
has stood at a stop sign.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from dohyo.agents.planning.stop_signs import NextStop
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray, IntArray, column
from dohyo.sumo_networks.geometry import project_on_path, wrap_angle
from dohyo.sumo_networks.objects import ObjectStates
from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.sensors.lanes import ATTRIBUTES, POINTS
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import LightState

SENSORS = ("ego_state", "objects", "lanes", "path", "junctions_ahead")
"""Sensors that a scene is built from."""

HISTORY = 4
HISTORY_STEP_S = 0.5
STOOD_SPEED, STOOD_DISTANCE_M = 0.1, 2.5
YELLOW_BRAKING = 3.0
_TICKS_PER_STEP = round(HISTORY_STEP_S / TICK_S)
_MEMORY = (HISTORY - 1) * _TICKS_PER_STEP + 1


@dataclass(frozen=True, slots=True)
class Ego:
    """The driven vehicle; its pose in its own frame is 0, 0, 0.

    Attributes:
        speed: m/s.
        acceleration: m/s^2.
        yaw_rate: rad/s.
        steering: Front wheel angle, rad.
        length: m.
        width: m.
        history: (4, 3) x, y [m], heading [rad] 1.5, 1.0, 0.5 and 0 s ago.
        history_valid: (4,) which of them were seen; the others are extrapolated at constant velocity.
    """

    speed: float
    acceleration: float
    yaw_rate: float
    steering: float
    length: float
    width: float
    history: FloatArray
    history_valid: BoolArray


@dataclass(frozen=True, slots=True)
class TrackedActors(ObjectStates):
    """The others, N of them, nearest first, in the ego's frame.

    Attributes:
        history: (N, 4, 3) x, y [m], heading [rad] 1.5, 1.0, 0.5 and 0 s ago, in the present ego frame.
        history_valid: (N, 4) which of them were seen; the others are extrapolated at constant velocity.
    """

    history: FloatArray = column(np.float64, HISTORY, 3)
    history_valid: BoolArray = column(np.bool_, HISTORY)


@dataclass(frozen=True, slots=True)
class LanePieces:
    """Pieces of lanes around the ego, L of them, nearest first; see `sensors.lanes`.

    Attributes:
        points: (L, 20, 2), m, in driving direction.
        width: (L,), m.
        limit: (L,), m/s.
        kind: (L,) 0 road, 1 inside a junction, 2 pedestrian crossing.
        on_route: (L,) 2 the route's own lane, 1 another lane of the route's roads, 0 neither.
        red: (L,) inside a junction, behind a red light.
        following: (L, 5) rows that continue each piece, -1 unused.
    """

    points: FloatArray
    width: FloatArray
    limit: FloatArray
    kind: IntArray
    on_route: IntArray
    red: BoolArray
    following: IntArray

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, slots=True)
class ReferencePath:
    """The route's reference path, R points about a metre apart.

    Attributes:
        position: (R, 2), m.
        heading: (R,), rad.
        curvature: (R,), 1/m, left positive.
        limit: (R,), m/s.
        width: (R,), m, of the lane there.
        s: (R,) arc length, m; 0 at the ego's projection, negative behind it.
        lateral: The ego's signed distance to the path, m: positive where the ego is to its left.
    """

    position: FloatArray
    heading: FloatArray
    curvature: FloatArray
    limit: FloatArray
    width: FloatArray
    s: FloatArray
    lateral: float


@dataclass(frozen=True, slots=True)
class StopLinesAhead:
    """Lines across the path ahead of the ego's front, S of them, nearest first.

    Attributes:
        s: (S,) arc length on the path, m.
        closed: (S,) must not be crossed now: red; yellow where the ego can stop; a stop sign not yet stood at.
        signal: (S,) `world.LightState`, -1 where there is no light.
    """

    s: FloatArray
    closed: BoolArray
    signal: IntArray


@dataclass(frozen=True, slots=True)
class Scene:
    """One tick, as planners and predictors see it.

    Attributes:
        time: Since the episode began, s.
        pose: (3,) x, y [m], heading [rad] of the ego in a frame that is fixed for the episode.
        ego: The driven vehicle.
        actors: The others.
        lanes: The map around the ego.
        path: The route.
        stop_lines: Lines at which the ego may have to stop.
    """

    time: float
    pose: FloatArray
    ego: Ego
    actors: TrackedActors
    lanes: LanePieces
    path: ReferencePath
    stop_lines: StopLinesAhead


class SceneBuilder:
    """Builds a scene from every tick's observation; needs `reset` between episodes."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Clears the state of the last episode."""
        self._tick = 0
        self._poses: deque[FloatArray] = deque(maxlen=_MEMORY)
        self._seen: deque[dict[int, FloatArray]] = deque(maxlen=_MEMORY)
        self._sign = NextStop(STOOD_SPEED, STOOD_DISTANCE_M)

    def update(self, observation: Observation) -> Scene:
        """The scene of the next tick.

        Args:
            observation: Holds at least the arrays of `SENSORS`.
        """
        state = observation["ego_state"].astype(np.float64)
        pose, speed = state[:3], float(state[3])
        rows = observation["objects"].astype(np.float64)
        rows = rows[rows[:, 0] >= 0]
        self._poses.append(pose)
        here = np.column_stack([_to_fixed(pose, rows[:, 1:3]), wrap_angle(rows[:, 3] + pose[2])])
        self._seen.append({int(key): place for key, place in zip(rows[:, 7], here, strict=True)})
        path = _path(observation["path"])
        ego = self._ego(state)
        scene = Scene(
            time=round(self._tick * TICK_S, 3),
            pose=pose,
            ego=ego,
            actors=self._actors(rows, pose),
            lanes=_lanes(observation["lanes"]),
            path=path,
            stop_lines=self._stop_lines(observation["junctions_ahead"], speed, ego.length),
        )
        self._tick += 1
        return scene

    def _ego(self, state: FloatArray) -> Ego:
        speed, acceleration, yaw_rate, steering, length, width = state[3:]
        history, valid = _constant_velocity(np.zeros(2), 0.0, float(speed)), np.zeros(HISTORY, dtype=np.bool_)
        for i, ago in enumerate(_AGO):
            if ago < len(self._poses):
                history[i], valid[i] = _to_ego(state[:3], self._poses[-1 - ago]), True
        return Ego(
            float(speed), float(acceleration), float(yaw_rate), float(steering), float(length), float(width), history,
            valid,
        )  # fmt: skip

    def _actors(self, rows: FloatArray, pose: FloatArray) -> TrackedActors:
        count = len(rows)
        history, valid = np.empty((count, HISTORY, 3)), np.zeros((count, HISTORY), dtype=np.bool_)
        for n, row in enumerate(rows):
            history[n] = _constant_velocity(row[1:3], float(row[3]), float(row[4]))
            for i, ago in enumerate(_AGO):
                place = self._seen[-1 - ago].get(int(row[7])) if ago < len(self._seen) else None
                if place is not None:
                    history[n, i], valid[n, i] = _to_ego(pose, place), True
        return TrackedActors(
            kind=rows[:, 0].astype(np.int64),
            key=rows[:, 7].astype(np.int64),
            position=rows[:, 1:3].copy(),
            heading=rows[:, 3].copy(),
            speed=rows[:, 4].copy(),
            length=rows[:, 5].copy(),
            width=rows[:, 6].copy(),
            history=history,
            history_valid=valid,
        )

    def _stop_lines(self, junctions: Float32Array, speed: float, length: float) -> StopLinesAhead:
        self._sign.update(speed, junctions)
        rows = np.flatnonzero((junctions[:, 0] > -0.5) & (junctions[:, 0] < 1000.0))
        ahead = junctions[rows].astype(np.float64)
        signal, distance = ahead[:, 2].astype(np.int64), ahead[:, 0]
        stoppable = speed**2 <= 2 * YELLOW_BRAKING * np.maximum(distance - 0.5, 0.0)
        closed = (signal == LightState.RED) | ((signal == LightState.YELLOW) & stoppable)
        signed = (ahead[:, 3].astype(np.int64) == RightOfWay.STOP) & ~((rows == self._sign.row) & self._sign.stood)
        return StopLinesAhead(s=distance + length / 2, closed=closed | signed, signal=signal)


_AGO = tuple((HISTORY - 1 - i) * _TICKS_PER_STEP for i in range(HISTORY))


def _constant_velocity(position: FloatArray, heading: float, speed: float) -> FloatArray:
    """(4, 3) past poses of an actor at constant velocity."""
    back = speed * TICK_S * np.array(_AGO, dtype=np.float64)
    out = np.empty((HISTORY, 3))
    out[:, 0] = position[0] - back * math.cos(heading)
    out[:, 1] = position[1] - back * math.sin(heading)
    out[:, 2] = heading
    return out


def _to_fixed(pose: FloatArray, points: FloatArray) -> FloatArray:
    """(N, 2) points of the ego frame in the fixed frame."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.asarray(points @ np.array([[cos, sin], [-sin, cos]]) + pose[:2])


def _to_ego(pose: FloatArray, place: FloatArray) -> FloatArray:
    """(3,) pose of the fixed frame in the ego frame."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = place[0] - pose[0], place[1] - pose[1]
    turn = (place[2] - pose[2] + math.pi) % (2 * math.pi) - math.pi
    return np.array([dx * cos + dy * sin, dy * cos - dx * sin, turn])


def _path(table: Float32Array) -> ReferencePath:
    """The path without the points that repeat before the start and past the goal."""
    rows = table.astype(np.float64)
    steps = np.hypot(*np.diff(rows[:, :2], axis=0).T)
    rows = rows[np.concatenate([steps > 1e-3, [False]]) | np.concatenate([[False], steps > 1e-3])]
    if len(rows) < 2:  # the whole route is behind: its last point, extended straight on
        rows = np.repeat(table[-1:].astype(np.float64), 2, axis=0)
        rows[1, :2] += math.cos(rows[0, 2]), math.sin(rows[0, 2])
    position = np.ascontiguousarray(rows[:, :2])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(position, axis=0).T))])
    spacing = float(arc[-1]) / (len(arc) - 1)
    along, lateral, _ = project_on_path(0.0, 0.0, position, spacing, 0, len(position))
    return ReferencePath(
        position=position,
        heading=rows[:, 2].copy(),
        curvature=rows[:, 3].copy(),
        limit=rows[:, 4].copy(),
        width=rows[:, 5].copy(),
        s=arc - along,
        lateral=lateral,
    )


def _lanes(table: Float32Array) -> LanePieces:
    rows = table[table[:, 0] >= 0].astype(np.float64)
    lane, piece, after = (
        rows[:, 0].astype(np.int64),
        rows[:, 1].astype(np.int64),
        rows[:, 7:ATTRIBUTES].astype(np.int64),
    )
    row_of = {pair: row for row, pair in enumerate(zip(lane.tolist(), piece.tolist(), strict=True))}
    following = np.full(after.shape, -1, dtype=np.int64)
    for row, (number, part) in enumerate(row_of):
        onward = [(number, part + 1), *((follower, 0) for follower in after[row].tolist() if follower >= 0)]
        found = [row_of[pair] for pair in onward if pair in row_of][: after.shape[1]]
        following[row, : len(found)] = found
    return LanePieces(
        points=np.ascontiguousarray(rows[:, ATTRIBUTES:].reshape(-1, POINTS, 2)),
        width=rows[:, 3].copy(),
        limit=rows[:, 4].copy(),
        kind=rows[:, 2].astype(np.int64),
        on_route=rows[:, 5].astype(np.int64),
        red=rows[:, 6] == LightState.RED,
        following=following,
    )
