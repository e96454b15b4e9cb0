"""Plan view of a drive as SVG: the lot, the path of each kart, and its pose every second."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from dohyo.evaluation.parking.benchmark import scene_of
from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.radar import Kind
from dohyo.sumo_networks.parking.rows import LotView
from dohyo.sumo_networks.parking.rules import JUDGED
from dohyo.sumo_networks.parking.tables import FREE, KIND, WALK_RADIUS
from dohyo.sumo_networks.parking.world import ParkingWorld

MARGIN_M = 2.0
POSE_EVERY = round(1.0 / kart.TICK_S)


def plan_view(record: ParkingRecord, motion: Float32Array) -> str:
    """SVG of a drive, north up, one unit per metre; classes of shapes are those of the page's styles.

    Args:
        record: The facts.
        motion: (T, K + P, 4) x, y [m], heading [rad], speed of all karts, then of pedestrians.
    """
    world = ParkingWorld(1, record.benchmark.karts)
    world.draw([0], [record.seed], scene_of(record.benchmark.scene), JUDGED)
    view = world.view(0)
    left, top, width, height = _frame(view, motion)
    shapes = [
        *_lot(view),
        *(shape for number in range(len(record.karts)) for shape in _drive(motion[:, number], number)),
    ]
    label = f"lot {record.seed}: " + ", ".join(one.ending.replace("_", " ") for one in record.karts)
    return (
        f'<svg class="plan" role="img" aria-label="{label}" '
        f'viewBox="{left:.2f} {top:.2f} {width:.2f} {height:.2f}">{"".join(shapes)}</svg>'
    )


def _frame(view: LotView, motion: Float32Array) -> tuple[float, float, float, float]:
    driven = motion[..., :2].reshape(-1, 2).astype(np.float64)
    points = np.concatenate([view.walls.reshape(-1, 2), view.spots[:, :2], view.boxes[:, :2], driven])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    return float(low[0]), float(-high[1]), float(high[0] - low[0]), float(high[1] - low[1])


def _lot(view: LotView) -> Iterable[str]:
    for spot in view.spots:
        yield _polygon(_corners(spot), "spot free" if spot[FREE] else "spot")
    for box in view.boxes:
        yield _polygon(_corners(box), "wall" if box[KIND] == Kind.WALL else "car")
    for wall in view.walls:
        yield _line(wall.reshape(2, 2), "wall")
    for walker in view.walkers:
        yield _line(walker[:4].reshape(2, 2), "walk")
        yield f'<circle class="walker" cx="{walker[0]:.2f}" cy="{-walker[1]:.2f}" r="{walker[WALK_RADIUS]:.2f}"/>'


def _drive(motion: Float32Array, number: int) -> Iterable[str]:
    """Path and poses of one kart; the last pose is filled."""
    standing = np.flatnonzero((motion[1:] != motion[:-1]).any(axis=1))
    moving = motion[: standing[-1] + 2] if len(standing) else motion[:1]
    yield _line(moving[:, :2].astype(np.float64), f"way kart-{number}")
    for pose in moving[:-1:POSE_EVERY]:
        yield _polygon(_corners(_box(pose)), f"pose kart-{number}")
    last = _corners(_box(moving[-1]))
    yield _polygon(last, f"kart kart-{number}")
    yield _line(last[[0, 3]], "nose")


def _box(pose: Float32Array) -> FloatArray:
    return np.array([pose[0], pose[1], pose[2], kart.LENGTH_M, kart.WIDTH_M], np.float64)


def _corners(box: FloatArray) -> FloatArray:
    """(4, 2) corners: front left, rear left, rear right, front right."""
    cos, sin = math.cos(box[2]), math.sin(box[2])
    local = 0.5 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * box[3:5]
    return np.asarray(box[:2] + local @ np.array([[cos, sin], [-sin, cos]]))


def _polygon(points: FloatArray, kind: str) -> str:
    return f'<polygon class="{kind}" points="{_points(points)}"/>'


def _line(points: FloatArray, kind: str) -> str:
    return f'<polyline class="{kind}" points="{_points(points)}"/>'


def _points(points: FloatArray) -> str:
    return " ".join(f"{x:.2f},{-y:.2f}" for x, y in points.tolist())
