"""Situation: a scene and its forecast as flat arrays for the planners' kernels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dohyo.agents.planning.motion import project
from dohyo.agents.planning.prediction import STEPS
from dohyo.agents.planning.scene import Ego, Scene, TrackedActors
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.sensors.lanes import CROSSING, JUNCTION
from dohyo.sumo_networks.world import ActorKind

CELL_M = 0.4
GRID_X_M, GRID_Y_M = (-30.0, 120.0), (-60.0, 60.0)
GRID_SHAPE = (round((GRID_X_M[1] - GRID_X_M[0]) / CELL_M), round((GRID_Y_M[1] - GRID_Y_M[0]) / CELL_M))
LANE_TOLERANCE_M = 0.2
ROAD_BIT, ROUTE_BIT, JUNCTION_BIT = 1, 2, 4
BEYOND_M = 60.0
FOLLOWS_COS = 0.7
NO_LINE = 1e9
COARSE_S = 0.5
COARSE_STEPS = 17
_STRIDE = 5
CLASS_PEDESTRIAN, CLASS_VEHICLE, CLASS_OBJECT = 0, 1, 2
_PEOPLE = (int(ActorKind.PEDESTRIAN), int(ActorKind.BICYCLE))


class Situation(NamedTuple):
    """Input of the kernels, in the present ego frame.

    Attributes:
        path: (R, 4) x, y [m], cosine and sine of the heading, equally spaced, straight on past the goal.
        curvature: (R,), 1/m.
        limit: (R,), m/s: the speed limit.
        allowed: (R,), m/s: the speed that limits and curves allow, braking in time.
        half_width: (R,), m, of the lane.
        first_s: Arc length of the first point, m; 0 is the ego's projection.
        spacing: m.
        line: Arc length of the first closed line, m.
        grid: Flags of road and route by cell, see `on_grid`.
        boxes: (81, N, 6) centre x, y [m], cosine, sine, half length, half width [m] every 0.1 s of all actors except
            followers in the ego's lane.
        speed: (N,), m/s.
        kind: (N,) 0 pedestrian or cyclist, 1 vehicle, 2 object.
        along: (17, N, 4) arc length on the path, lateral distance to it, half extents across and along it [m], every
            0.5 s.
        along_speed: (17, N), m/s, along the path.
        reach: (N,) half diagonal, m.
    """

    path: FloatArray
    curvature: FloatArray
    limit: FloatArray
    allowed: FloatArray
    half_width: FloatArray
    first_s: float
    spacing: float
    line: float
    grid: np.ndarray
    boxes: FloatArray
    speed: FloatArray
    kind: IntArray
    along: FloatArray
    along_speed: FloatArray
    reach: FloatArray


def situation(scene: Scene, forecast: FloatArray, *, max_speed: float, curve: float, braking: float) -> Situation:
    """Prepares a scene.

    Args:
        scene: The scene.
        forecast: (N, 81, 3) poses of its actors.
        max_speed: Upper bound under any speed limit, m/s.
        curve: Lateral acceleration in curves, m/s^2.
        braking: Deceleration before them, m/s^2.
    """
    path, limit, half_width, curvature = _extended(scene)
    spacing = float(scene.path.s[-1] - scene.path.s[0]) / (len(scene.path.s) - 1)
    first_s = float(scene.path.s[0])
    limit = np.minimum(limit, max_speed)
    allowed = _allowed_speed(limit, curvature, curve, braking, spacing)
    grid = np.zeros(GRID_SHAPE, dtype=np.uint8)
    lanes = scene.lanes
    open_lane = (lanes.kind != CROSSING) & ~lanes.red
    _draw_lanes(grid, lanes.points, lanes.width, lanes.on_route, lanes.kind == JUNCTION, open_lane)
    _draw_path(grid, path, half_width)
    actors, forecast = _minded(scene.actors, scene.ego, forecast)
    boxes = np.empty((STEPS, len(actors), 6))
    boxes[:, :, :2] = forecast[:, :, :2].transpose(1, 0, 2)
    boxes[:, :, 2], boxes[:, :, 3] = np.cos(forecast[:, :, 2]).T, np.sin(forecast[:, :, 2]).T
    boxes[:, :, 4], boxes[:, :, 5] = actors.length / 2, actors.width / 2
    along, along_speed = np.empty((COARSE_STEPS, len(actors), 4)), np.empty((COARSE_STEPS, len(actors)))
    _along_path(path, first_s, spacing, boxes, along, along_speed)
    closed = scene.stop_lines.s[scene.stop_lines.closed]
    kind = np.where(
        np.isin(actors.kind, _PEOPLE),
        CLASS_PEDESTRIAN,
        np.where(actors.kind == ActorKind.STATIC, CLASS_OBJECT, CLASS_VEHICLE),
    ).astype(np.int64)
    return Situation(
        path=path,
        curvature=curvature,
        limit=limit,
        allowed=allowed,
        half_width=half_width,
        first_s=first_s,
        spacing=spacing,
        line=float(closed.min()) if len(closed) else NO_LINE,
        grid=grid,
        boxes=boxes,
        speed=np.ascontiguousarray(actors.speed),
        kind=kind,
        along=along,
        along_speed=along_speed,
        reach=np.hypot(actors.length, actors.width) / 2,
    )


def _minded(actors: TrackedActors, ego: Ego, forecast: FloatArray) -> tuple[TrackedActors, FloatArray]:
    """All actors except followers in the ego's lane, which have to keep their own distance."""
    behind = actors.position[:, 0] + actors.length / 2 < -ego.length / 2
    beside = np.abs(actors.position[:, 1]) < (ego.width + actors.width) / 2
    keep = ~(behind & beside & (np.cos(actors.heading) > FOLLOWS_COS))
    return actors.take(keep), forecast[keep]


def _extended(scene: Scene) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Path (R, 4), limit, half width and curvature, with a straight stretch past the end."""
    p = scene.path
    spacing = float(p.s[-1] - p.s[0]) / (len(p.s) - 1)
    more = math.ceil(BEYOND_M / spacing)
    steps = np.arange(1, more + 1) * spacing
    cos, sin = math.cos(p.heading[-1]), math.sin(p.heading[-1])
    path = np.empty((len(p.s) + more, 4))
    path[: len(p.s), :2], path[: len(p.s), 2], path[: len(p.s), 3] = p.position, np.cos(p.heading), np.sin(p.heading)
    path[len(p.s) :] = np.column_stack([
        p.position[-1, 0] + steps * cos, p.position[-1, 1] + steps * sin, np.full(more, cos), np.full(more, sin)
    ])  # fmt: skip
    longer = (np.concatenate([a, np.full(more, a[-1])]) for a in (p.limit, p.width / 2))
    limit, half_width = longer
    return path, limit, half_width, np.concatenate([p.curvature, np.zeros(more)])


@njit(cache=True, error_model="numpy")
def _allowed_speed(
    limit: FloatArray, curvature: FloatArray, lateral: float, braking: float, spacing: float
) -> FloatArray:
    """(R,) speed that limits and curves allow, with braking in time for those ahead, m/s."""
    out = np.empty(limit.shape[0])
    ahead = math.inf
    for i in range(limit.shape[0] - 1, -1, -1):
        curve = math.sqrt(lateral / max(abs(curvature[i]), 1e-4))
        ahead = min(limit[i], curve, math.sqrt(ahead * ahead + 2.0 * braking * spacing))
        out[i] = ahead
    return out


@njit(cache=True, error_model="numpy")
def _draw_strip(grid: np.ndarray, x0: float, y0: float, x1: float, y1: float, half: float, bits: int) -> None:
    """Sets bits of all cells whose centre is within `half` of a segment, round ends left out."""
    ux, uy = x1 - x0, y1 - y0
    square = ux * ux + uy * uy
    if square < 1e-9:
        return
    low_x, high_x = min(x0, x1) - half, max(x0, x1) + half
    low_y, high_y = min(y0, y1) - half, max(y0, y1) + half
    c0, c1 = max(int((low_x - GRID_X_M[0]) / CELL_M), 0), min(int((high_x - GRID_X_M[0]) / CELL_M) + 1, grid.shape[0])
    r0, r1 = max(int((low_y - GRID_Y_M[0]) / CELL_M), 0), min(int((high_y - GRID_Y_M[0]) / CELL_M) + 1, grid.shape[1])
    slack = CELL_M / math.sqrt(square)
    across = half * math.sqrt(square)
    for c in range(c0, c1):
        dx = GRID_X_M[0] + (c + 0.5) * CELL_M - x0
        for r in range(r0, r1):
            dy = GRID_Y_M[0] + (r + 0.5) * CELL_M - y0
            t = (dx * ux + dy * uy) / square
            if -slack <= t <= 1.0 + slack and abs(ux * dy - uy * dx) <= across:
                grid[c, r] |= bits


@njit(cache=True, error_model="numpy")
def _draw_lanes(
    grid: np.ndarray,
    points: FloatArray,
    width: FloatArray,
    on_route: IntArray,
    inside: np.ndarray,
    is_open: np.ndarray,
) -> None:
    for lane in range(points.shape[0]):
        bits = JUNCTION_BIT if inside[lane] else 0
        if is_open[lane]:
            bits |= ROAD_BIT | ROUTE_BIT if on_route[lane] > 0 else ROAD_BIT
        if bits == 0:
            continue
        # A straight piece is one strip.
        first, last = points[lane, 0], points[lane, points.shape[1] - 1]
        chord = math.hypot(last[0] - first[0], last[1] - first[1])
        length = 0.0
        for p in range(points.shape[1] - 1):
            length += math.hypot(
                points[lane, p + 1, 0] - points[lane, p, 0], points[lane, p + 1, 1] - points[lane, p, 1]
            )
        half = 0.5 * width[lane] + LANE_TOLERANCE_M
        if length - chord < 0.01:
            _draw_strip(grid, first[0], first[1], last[0], last[1], half, bits)
            continue
        for p in range(points.shape[1] - 1):
            a, b = points[lane, p], points[lane, p + 1]
            _draw_strip(grid, a[0], a[1], b[0], b[1], half, bits)


@njit(cache=True, error_model="numpy")
def _draw_path(grid: np.ndarray, path: FloatArray, half_width: FloatArray) -> None:
    for i in range(path.shape[0] - 1):
        half = half_width[i] + LANE_TOLERANCE_M
        _draw_strip(grid, path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1], half, ROAD_BIT | ROUTE_BIT)


@njit(cache=True, error_model="numpy")
def on_grid(grid: np.ndarray, x: float, y: float) -> int:
    """Flags at a point: 1 road, 2 the route's roads, 4 inside a junction. Beyond the grid all is road and route."""
    c, r = math.floor((x - GRID_X_M[0]) / CELL_M), math.floor((y - GRID_Y_M[0]) / CELL_M)
    if c < 0 or r < 0 or c >= grid.shape[0] or r >= grid.shape[1]:
        return ROAD_BIT | ROUTE_BIT
    return int(grid[c, r])


@njit(cache=True, error_model="numpy")
def box_on_grid(
    grid: np.ndarray, x: float, y: float, cos: float, sin: float, half_length: float, half_width: float
) -> int:
    """Flags that all four corners of a box share."""
    ax, ay, bx, by = half_length * cos, half_length * sin, -half_width * sin, half_width * cos
    flags = on_grid(grid, x + ax + bx, y + ay + by) & on_grid(grid, x + ax - bx, y + ay - by)
    flags &= on_grid(grid, x - ax + bx, y - ay + by) & on_grid(grid, x - ax - bx, y - ay - by)
    return int(flags)


@njit(cache=True, error_model="numpy")
def _along_path(
    path: FloatArray, first_s: float, spacing: float, boxes: FloatArray, along: FloatArray, along_speed: FloatArray
) -> None:
    """Position and speed of every actor along the path, every half second."""
    for n in range(boxes.shape[1]):
        near, reach = first_s + 0.5 * path.shape[0] * spacing, 1e6
        for k in range(along.shape[0]):
            x, y, cos, sin, half_length, half_width = boxes[_STRIDE * k, n]
            if k > 0:
                reach = 12.0 + abs(x - boxes[_STRIDE * (k - 1), n, 0]) + abs(y - boxes[_STRIDE * (k - 1), n, 1])
            near, side, row = project(path, first_s, spacing, x, y, near, reach)
            pc, ps = path[row, 2], path[row, 3]
            along[k, n, 0], along[k, n, 1] = near, side
            straight, turned = abs(cos * pc + sin * ps), abs(cos * ps - sin * pc)
            along[k, n, 2] = half_width * straight + half_length * turned
            along[k, n, 3] = half_length * straight + half_width * turned
            a, b = _STRIDE * k, min(_STRIDE * (k + 1), boxes.shape[0] - 1)
            a = min(a, b - _STRIDE)
            along_speed[k, n] = (
                (boxes[b, n, 0] - boxes[a, n, 0]) * pc + (boxes[b, n, 1] - boxes[a, n, 1]) * ps
            ) / COARSE_S


@njit(cache=True, error_model="numpy")
def leader(road: Situation, half_length: float, half_width: float, s: float, time: float, offset: float):  # type: ignore[no-untyped-def]
    """Nearest actor ahead in the corridor along the path at a future time.

    Args:
        road: The situation.
        half_length: Of the ego, m.
        half_width: Of the corridor, m.
        s: Arc length of the ego's centre, m.
        time: From the present, s.
        offset: Of the corridor, to the left of the path, m.

    Returns:
        Gap between the bumpers [m], infinite without an actor, and its speed along the path [m/s].
    """
    k = min(int(time / COARSE_S + 0.5), road.along.shape[0] - 1)
    best, speed = math.inf, 0.0
    for n in range(road.along.shape[1]):
        ahead = road.along[k, n, 0] - s
        if ahead <= 0.0 or abs(road.along[k, n, 1] - offset) > half_width + road.along[k, n, 2]:
            continue
        gap = ahead - half_length - road.along[k, n, 3]
        if gap < best:
            best, speed = gap, max(road.along_speed[k, n], 0.0)
    return best, speed


@njit(cache=True, error_model="numpy")
def at_row(road: Situation, s: float) -> int:
    """Row of the path point at or before an arc length."""
    row = int((s - road.first_s) / road.spacing)
    return int(min(max(row, 0), road.path.shape[0] - 1))
