"""Hand-made scenes: actors where told, lanes as told, in the ego's frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dohyo.agents.mcts.predictors.dataset import FUTURE_STEP_S, FUTURE_STEPS, Sample
from dohyo.agents.planning.scene import HISTORY, Ego, LanePieces, ReferencePath, Scene, StopLinesAhead, TrackedActors
from dohyo.sumo_networks.world import ActorKind

AGO = np.array([1.5, 1.0, 0.5, 0.0])


@dataclass(frozen=True)
class Body:
    x: float
    y: float
    speed: float = 0.0
    heading: float = 0.0
    kind: ActorKind = ActorKind.CAR
    length: float = 4.0
    width: float = 1.8


@dataclass(frozen=True)
class Lane:
    """A straight piece from one point to another, or bent through more."""

    points: tuple[tuple[float, float], ...]
    following: tuple[int, ...] = ()
    limit: float = 10.0
    kind: int = 0
    on_route: int = 0
    red: bool = False


def straight(start: float, end: float, y: float = 0.0, **facts: object) -> Lane:
    return Lane(((start, y), (end, y)), **facts)  # type: ignore[arg-type]


def scene(actors: Sequence[Body] = (), lanes: Sequence[Lane] = (), ego_speed: float = 0.0) -> Scene:
    return Scene(
        time=3.0,
        pose=np.zeros(3),
        ego=Ego(ego_speed, 0.0, 0.0, 0.0, 4.5, 1.8, history(0.0, 0.0, 0.0, ego_speed), np.ones(HISTORY, dtype=bool)),
        actors=TrackedActors(
            kind=np.array([int(a.kind) for a in actors], dtype=np.int64),
            key=np.arange(len(actors)),
            position=np.array([(a.x, a.y) for a in actors]).reshape(-1, 2),
            heading=np.array([a.heading for a in actors], dtype=float),
            speed=np.array([a.speed for a in actors], dtype=float),
            length=np.array([a.length for a in actors], dtype=float),
            width=np.array([a.width for a in actors], dtype=float),
            history=np.array([history(a.x, a.y, a.heading, a.speed) for a in actors]).reshape(-1, HISTORY, 3),
            history_valid=np.ones((len(actors), HISTORY), dtype=bool),
        ),
        lanes=LanePieces(
            points=np.array([_twenty(lane.points) for lane in lanes]).reshape(-1, 20, 2),
            width=np.full(len(lanes), 3.2),
            limit=np.array([lane.limit for lane in lanes], dtype=float),
            kind=np.array([lane.kind for lane in lanes], dtype=np.int64),
            on_route=np.array([lane.on_route for lane in lanes], dtype=np.int64),
            red=np.array([lane.red for lane in lanes], dtype=bool),
            following=np.array([(*lane.following, -1, -1, -1, -1, -1)[:5] for lane in lanes], np.int64).reshape(-1, 5),
        ),
        path=ReferencePath(
            position=np.column_stack([np.arange(3.0), np.zeros(3)]),
            heading=np.zeros(3),
            curvature=np.zeros(3),
            limit=np.full(3, 10.0),
            width=np.full(3, 3.2),
            s=np.arange(3.0),
            lateral=0.0,
        ),
        stop_lines=StopLinesAhead(s=np.array([30.0]), closed=np.array([True]), signal=np.array([1])),
    )


def history(x: float, y: float, heading: float, speed: float) -> np.ndarray:
    """(4, 3) of somebody who drove straight on."""
    back = AGO * speed
    return np.column_stack([x - back * math.cos(heading), y - back * math.sin(heading), np.full(HISTORY, heading)])


def busy(seed: int, actors: int = 12, lanes: int = 9) -> Scene:
    """A scene at random."""
    rng = np.random.default_rng(seed)
    bodies = [
        Body(
            *rng.uniform(-40, 40, 2),
            speed=rng.uniform(0, 14),
            heading=rng.uniform(-3, 3),
            kind=ActorKind(int(rng.choice([0, 1, 2, 4, 6]))),
            length=rng.uniform(1, 8),
        )
        for _ in range(actors)
    ]
    bodies.sort(key=lambda body: math.hypot(body.x, body.y))
    pieces = []
    for _ in range(lanes):
        start, angle = rng.uniform(-30, 30, 2), rng.uniform(-3, 3)
        bend = angle + rng.uniform(-0.5, 0.5)
        middle = start + 12 * np.array([math.cos(angle), math.sin(angle)])
        end = middle + 12 * np.array([math.cos(bend), math.sin(bend)])
        pieces.append(Lane((tuple(start), tuple(middle), tuple(end)), red=bool(rng.random() < 0.3)))
    return scene(bodies, pieces, ego_speed=float(rng.uniform(0, 12)))


def sampled(now: Scene) -> Sample:
    """A scene of which all came true that constant velocity says."""
    ahead = (np.arange(FUTURE_STEPS) + 1) * FUTURE_STEP_S
    actors = now.actors
    future = np.zeros((len(actors) + 1, FUTURE_STEPS, 3), dtype=np.float32)
    speed, heading = np.append(now.ego.speed, actors.speed), np.append(0.0, actors.heading)
    position = np.concatenate([np.zeros((1, 2)), actors.position])
    future[:, :, 0] = position[:, :1] + (speed * np.cos(heading))[:, None] * ahead
    future[:, :, 1] = position[:, 1:] + (speed * np.sin(heading))[:, None] * ahead
    future[:, :, 2] = heading[:, None]
    valid = np.ones(future.shape[:2], dtype=np.bool_)
    return Sample(now, future[0], valid[0], future[1:], valid[1:])


def moved(now: Scene, dx: float, dy: float, angle: float) -> Scene:
    """The same actors and lanes, the ego included, seen from elsewhere."""
    actors, lanes, ego = now.actors, now.lanes, now.ego
    return replace(
        now,
        ego=replace(ego, history=turned(ego.history, dx, dy, angle)),
        actors=replace(
            actors,
            position=turned(actors.position, dx, dy, angle),
            heading=actors.heading + angle,
            history=turned(actors.history, dx, dy, angle),
        ),
        lanes=replace(lanes, points=turned(lanes.points, dx, dy, angle)),
    )


def turned(poses: np.ndarray, dx: float, dy: float, angle: float) -> np.ndarray:
    """(..., 2) points or (..., 3) poses, turned around the origin, then shifted."""
    cos, sin = math.cos(angle), math.sin(angle)
    out = poses.copy()
    out[..., 0] = poses[..., 0] * cos - poses[..., 1] * sin + dx
    out[..., 1] = poses[..., 0] * sin + poses[..., 1] * cos + dy
    if poses.shape[-1] == 3:
        out[..., 2] = poses[..., 2] + angle
    return out


def _twenty(points: Sequence[tuple[float, float]]) -> np.ndarray:
    corners = np.array(points, dtype=float)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    at = np.linspace(0.0, arc[-1], 20)
    return np.column_stack([np.interp(at, arc, corners[:, i]) for i in (0, 1)])
