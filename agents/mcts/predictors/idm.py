"""IDM roll-out: every vehicle keeps its lane, and follows the Intelligent Driver Model to leaders and red lights.

All are simulated together, so that leaders brake for their own leaders. There are no lane changes. At a fork a vehicle
takes the straightest branch, and the ego its route. Pedestrians, objects and actors off the lanes keep their velocity.
A vehicle that has stood beside the middle of its lane is parked, and stays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dohyo.agents.mcts.kernels import kernel
from dohyo.agents.planning.motion import Idm, idm_acceleration
from dohyo.agents.planning.prediction import STEP_S, STEPS, Forecast
from dohyo.agents.planning.scene import LanePieces, Scene
from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.geometry import wrap
from dohyo.sumo_networks.sensors.lanes import CROSSING, JUNCTION
from dohyo.sumo_networks.world import ActorKind

MODEL = Idm(gap=2.0, headway=1.0, acceleration=2.0, braking=2.5, exponent=4.0, least_gap=0.1, hardest=6.0)
"""SUMO's cars keep 2.5 m and 1 s; the other values are usual ones."""
SPACING_M, PATH_POINTS = 2.0, 90
LATERAL_ACCELERATION, CURVE_BRAKING = 2.5, 2.0
ASIDE_M, MOST_TURN = 1.0, math.pi / 3
HEADING_COST_M = 3.0
"""Lateral distance, m, that one radian of heading error counts for."""
CENTRING_S = 2.0
LEADER_TICKS = 5
BESIDE_M = 0.3
LINE_GAP_M = 1.0
STOPPABLE = 4.0
BICYCLE_SPEED = 5.0
FAR = 1e9
ROUTE_BONUS = 10.0
PARKED_ASIDE_M, PARKED_MOVED_M = 0.9, 0.2
"""Parked: lateral distance to the middle of the lane above, and movement in the last 1.5 s below, these, m."""
_ON_FOOT = (int(ActorKind.PEDESTRIAN), int(ActorKind.STATIC))


class Agents(NamedTuple):
    """Ego and others, N agents.

    Attributes:
        pose: (N, 3) x, y [m], heading [rad].
        speed: (N,), m/s.
        length: (N,), m.
        width: (N,), m.
        fastest: (N,), m/s, upper bound under any limit.
        drives: (N,) whether the agent follows lanes.
    """

    pose: FloatArray
    speed: FloatArray
    length: FloatArray
    width: FloatArray
    fastest: FloatArray
    drives: BoolArray


class Paths(NamedTuple):
    """N paths of 90 points, 2 m apart, from the foot point on each agent's lane; straight on at the end.

    Attributes:
        points: (N, 90, 4) x, y [m], cosine, sine.
        heading: (N, 90), rad.
        allowed: (N, 90), m/s: limit and curves, braking in time.
        line: (N,) arc length of the first red light's line, m.
        lateral: (N,), m, distance of the agent to the left of its path.
        found: (N,) whether the agent is on a lane.
    """

    points: FloatArray
    heading: FloatArray
    allowed: FloatArray
    line: FloatArray
    lateral: FloatArray
    found: BoolArray


class Motion(NamedTuple):
    """What changes in a roll-out, beside the poses; all (N,).

    Attributes:
        speed: m/s.
        before: Speed in the step before, m/s.
        s: Arc length on the path, m.
        turn: Angle to the path at first, rad.
        gap: To the leader, m.
        leader: Its row, -1 for none.
    """

    speed: FloatArray
    before: FloatArray
    s: FloatArray
    turn: FloatArray
    gap: FloatArray
    leader: IntArray


class IdmRollout:
    """IDM predictor; see the module.

    Source: Treiber, Hennecke, Helbing 2000.
    """

    def __init__(self, model: Idm = MODEL) -> None:
        self.model = model

    def predict(self, scene: Scene) -> Forecast:
        """See the module."""
        agents = _agents(scene)
        way = paths(scene, agents)
        moved = np.hypot(*(scene.actors.history[:, 0, :2] - scene.actors.position).T)
        way.found[1:] &= (moved > PARKED_MOVED_M) | (np.abs(way.lateral[1:]) < PARKED_ASIDE_M)
        poses = roll_out(self.model, agents, way)
        poses[1:, 0] = agents.pose[1:]
        return Forecast(actors=poses[1:], ego=poses[0])


def paths(scene: Scene, agents: Agents) -> Paths:
    """The path of every agent."""
    lanes, count = scene.lanes, len(agents.speed)
    out = Paths(
        points=np.zeros((count, PATH_POINTS, 4)),
        heading=np.zeros((count, PATH_POINTS)),
        allowed=np.zeros((count, PATH_POINTS)),
        line=np.full(count, FAR),
        lateral=np.zeros(count),
        found=np.zeros(count, dtype=np.bool_),
    )
    if len(lanes):
        drivable = lanes.kind != CROSSING
        length = np.hypot(*np.diff(lanes.points, axis=1).transpose(2, 0, 1)).sum(axis=1)
        reach = length + 0.5 * lanes.width + ASIDE_M  # to its middle, with a margin
        red = _begin_at_red(lanes)
        _find(
            agents, lanes.points, lanes.width, lanes.limit, reach, drivable, lanes.on_route, red, lanes.following, out,
        )  # fmt: skip
    return out


def _begin_at_red(lanes: LanePieces) -> BoolArray:
    """(L,) whether a red light stands where a piece begins: a way through a junction has one line, at its beginning."""
    within = lanes.following[lanes.kind == JUNCTION]
    red = lanes.red.copy()
    red[within[within >= 0]] = False
    return red


def _agents(scene: Scene) -> Agents:
    ego, actors = scene.ego, scene.actors
    speed = np.concatenate([[ego.speed], actors.speed])
    fastest = np.where(actors.kind == ActorKind.BICYCLE, np.maximum(actors.speed, BICYCLE_SPEED), FAR)
    return Agents(
        pose=np.concatenate([ego.history[-1:], np.column_stack([actors.position, actors.heading])]),
        speed=speed,
        length=np.concatenate([[ego.length], actors.length]),
        width=np.concatenate([[ego.width], actors.width]),
        fastest=np.concatenate([[FAR], fastest]),
        drives=np.concatenate([[True], ~np.isin(actors.kind, _ON_FOOT)]),
    )


@kernel
def _foot(points: FloatArray, x: float, y: float) -> tuple[int, float, float, float]:
    """Nearest place on a polyline: segment, share of it, signed distance [m, left positive], direction [rad]."""
    best, row, share = math.inf, 0, 0.0
    for i in range(points.shape[0] - 1):
        ux, uy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
        dx, dy = x - points[i, 0], y - points[i, 1]
        square = ux * ux + uy * uy
        t = min(max((dx * ux + dy * uy) / square, 0.0), 1.0) if square > 0.0 else 0.0
        ex, ey = dx - t * ux, dy - t * uy
        if ex * ex + ey * ey < best:
            best, row, share = ex * ex + ey * ey, i, t
    ux, uy = points[row + 1, 0] - points[row, 0], points[row + 1, 1] - points[row, 1]
    side = ux * (y - points[row, 1]) - uy * (x - points[row, 0])
    return row, share, math.copysign(math.sqrt(best), side), math.atan2(uy, ux)


@kernel
def _onward(now: int, points: FloatArray, following: IntArray, on_route: IntArray, ego: bool) -> int:
    """Piece after another one: the straightest, for the ego its route's; -1 at the end of the known map."""
    before = math.atan2(points[now, -1, 1] - points[now, -2, 1], points[now, -1, 0] - points[now, -2, 0])
    best, chosen = math.inf, -1
    for k in range(following.shape[1]):
        piece = following[now, k]
        if piece < 0:
            continue
        end = math.atan2(points[piece, -1, 1] - points[piece, -2, 1], points[piece, -1, 0] - points[piece, -2, 0])
        cost = abs(wrap(end - before))
        if ego:
            cost -= ROUTE_BONUS * on_route[piece]
        if cost < best:
            best, chosen = cost, piece
    return chosen


@kernel
def _find(
    agents: Agents,
    points: FloatArray,
    width: FloatArray,
    limit: FloatArray,
    reach: FloatArray,
    drivable: BoolArray,
    on_route: IntArray,
    red: BoolArray,
    following: IntArray,
    out: Paths,
) -> None:
    for n in range(agents.speed.shape[0]):
        if not agents.drives[n]:
            continue
        x, y, heading = agents.pose[n]
        best, piece, segment, share = math.inf, -1, 0, 0.0
        for p in range(points.shape[0]):
            middle = points[p, points.shape[1] // 2]
            if not drivable[p] or abs(middle[0] - x) > reach[p] or abs(middle[1] - y) > reach[p]:
                continue
            row, at, side, direction = _foot(points[p], x, y)
            turn = abs(wrap(direction - heading))
            if abs(side) > 0.5 * width[p] + ASIDE_M or turn > MOST_TURN:
                continue
            cost = abs(side) + HEADING_COST_M * turn - (0.5 * on_route[p] if n == 0 else 0.0)
            if cost < best:
                best, piece, segment, share = cost, p, row, at
                out.lateral[n] = side
        if piece >= 0:
            out.found[n] = True
            _lay(n, piece, segment, share, points, limit, red, following, on_route, agents.fastest[n], out)


@kernel
def _lay(
    n: int,
    piece: int,
    segment: int,
    share: float,
    points: FloatArray,
    limit: FloatArray,
    red: BoolArray,
    following: IntArray,
    on_route: IntArray,
    fastest: float,
    out: Paths,
) -> None:
    """Writes points and speeds of a path along pieces."""
    x = points[piece, segment, 0] + share * (points[piece, segment + 1, 0] - points[piece, segment, 0])
    y = points[piece, segment, 1] + share * (points[piece, segment + 1, 1] - points[piece, segment, 1])
    row, left, travelled, filled = segment + 1, 0.0, 0.0, 0
    cos, sin, fast = 1.0, 0.0, limit[piece]
    while filled < PATH_POINTS:
        if row == points.shape[1]:
            piece = _onward(piece, points, following, on_route, n == 0)
            if piece < 0:
                break
            if red[piece] and out.line[n] == FAR:
                out.line[n] = travelled
            row, fast = 0, limit[piece]
        dx, dy = points[piece, row, 0] - x, points[piece, row, 1] - y
        step = math.hypot(dx, dy)
        if step > 1e-6:
            cos, sin = dx / step, dy / step
            while left <= step and filled < PATH_POINTS:
                out.points[n, filled] = x + left * cos, y + left * sin, cos, sin
                out.allowed[n, filled] = min(fast, fastest)
                filled += 1
                left += SPACING_M
            left -= step
            x, y, travelled = x + dx, y + dy, travelled + step
        row += 1
    while filled < PATH_POINTS:  # beyond the known map
        out.points[n, filled] = x + left * cos, y + left * sin, cos, sin
        out.allowed[n, filled] = min(fast, fastest)
        filled += 1
        left += SPACING_M
    for i in range(PATH_POINTS):
        out.heading[n, i] = math.atan2(out.points[n, i, 3], out.points[n, i, 2])
    for i in range(1, PATH_POINTS - 1):
        bend = abs(wrap(out.heading[n, i + 1] - out.heading[n, i - 1])) / (2.0 * SPACING_M)
        out.allowed[n, i] = min(out.allowed[n, i], math.sqrt(LATERAL_ACCELERATION / max(bend, 1e-4)))
    for i in range(PATH_POINTS - 2, -1, -1):
        reachable = math.sqrt(out.allowed[n, i + 1] ** 2 + 2.0 * CURVE_BRAKING * SPACING_M)
        out.allowed[n, i] = min(out.allowed[n, i], reachable)


def roll_out(model: Idm, agents: Agents, way: Paths) -> FloatArray:
    """(N, 81, 3) poses of all agents, every 0.1 s."""
    count = len(agents.speed)
    out, bounds = np.empty((count, STEPS, 3)), np.empty((count, 4))
    speed, before, s, turn, gap = np.zeros((5, count))
    now, moving = agents.pose.copy(), Motion(speed, before, s, turn, gap, np.full(count, -1))
    _roll(model, agents, way, bounds, now, moving, out)
    return out


@kernel
def _roll(
    model: Idm, agents: Agents, way: Paths, bounds: FloatArray, now: FloatArray, moving: Motion, out: FloatArray
) -> None:
    """Writes the poses of all agents, every 0.1 s, and changes the present ones."""
    count = agents.speed.shape[0]
    speed, before, s, turn, gap, leader = moving
    for n in range(count):
        speed[n], gap[n] = agents.speed[n], math.inf
        turn[n] = wrap(now[n, 2] - way.heading[n, 0]) if way.found[n] else 0.0
    _bound(way, bounds)
    for k in range(STEPS):
        for n in range(count):
            out[n, k, 0], out[n, k, 1], out[n, k, 2] = now[n, 0], now[n, 1], now[n, 2]
        if k % LEADER_TICKS == 0:
            _leaders(agents, way, bounds, now, s, leader, gap)
        fading = math.exp(-(k + 1) * STEP_S / CENTRING_S)
        for n in range(count):
            before[n] = speed[n]
        for n in range(count):
            if not way.found[n]:
                now[n, 0] += speed[n] * STEP_S * math.cos(now[n, 2])
                now[n, 1] += speed[n] * STEP_S * math.sin(now[n, 2])
                continue
            row = min(max(int(s[n] / SPACING_M), 0), PATH_POINTS - 2)
            ahead = leader[n]
            their = before[ahead] * math.cos(now[ahead, 2] - now[n, 2]) if ahead >= 0 else 0.0
            drive = idm_acceleration(model, speed[n], way.allowed[n, row], gap[n], max(their, 0.0))
            to_line = way.line[n] - s[n] - 0.5 * agents.length[n]
            if to_line > 0.0 and speed[n] ** 2 <= 2.0 * STOPPABLE * to_line:
                free = to_line + model.gap - LINE_GAP_M
                drive = min(drive, idm_acceleration(model, speed[n], way.allowed[n, row], free, 0.0))
            faster = max(speed[n] + drive * STEP_S, 0.0)
            moved = 0.5 * (speed[n] + faster) * STEP_S
            s[n], speed[n] = s[n] + moved, faster
            gap[n] += max(their, 0.0) * STEP_S - moved
            _place(way, n, s[n], fading * way.lateral[n], fading * turn[n], now[n])


@kernel
def _place(way: Paths, n: int, s: float, lateral: float, turn: float, now: FloatArray) -> None:
    """The pose at an arc length, at a distance [m] and an angle [rad] to the path."""
    points, heading = way.points[n], way.heading[n]
    row = min(max(int(s / SPACING_M), 0), PATH_POINTS - 2)
    share = s / SPACING_M - row
    direction = heading[row] + min(max(share, 0.0), 1.0) * wrap(heading[row + 1] - heading[row])
    now[0] = points[row, 0] + share * (points[row + 1, 0] - points[row, 0]) - lateral * math.sin(direction)
    now[1] = points[row, 1] + share * (points[row + 1, 1] - points[row, 1]) + lateral * math.cos(direction)
    now[2] = wrap(direction + turn)


@kernel
def _bound(way: Paths, out: FloatArray) -> None:
    """Writes the (N, 4) least and greatest x, least and greatest y of every path, m."""
    for n in range(out.shape[0]):
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = math.inf, -math.inf, math.inf, -math.inf
        for i in range(way.points.shape[1]):
            x, y = way.points[n, i, 0], way.points[n, i, 1]
            out[n, 0], out[n, 1] = min(out[n, 0], x), max(out[n, 1], x)
            out[n, 2], out[n, 3] = min(out[n, 2], y), max(out[n, 3], y)


@kernel
def _leaders(
    agents: Agents, way: Paths, bounds: FloatArray, now: FloatArray, s: FloatArray, leader: IntArray, gap: FloatArray
) -> None:
    """Leader on each path, and the gap, m."""
    count = agents.speed.shape[0]
    for n in range(count):
        last = leader[n]
        leader[n], gap[n] = -1, math.inf
        if not way.found[n]:
            continue
        # The previous leader is most likely still the leader, which bounds the search.
        if last >= 0:
            _follow(agents, way, now, s[n], n, last, leader, gap)
        for m in range(count):
            spare = 0.5 * (agents.width[n] + agents.width[m]) + BESIDE_M + SPACING_M
            x, y, box = now[m, 0], now[m, 1], bounds[n]
            near = box[0] - spare <= x <= box[1] + spare and box[2] - spare <= y <= box[3] + spare
            if near and m != n and m != last:
                _follow(agents, way, now, s[n], n, m, leader, gap)


@kernel
def _follow(
    agents: Agents, way: Paths, now: FloatArray, s: float, n: int, m: int, leader: IntArray, gap: FloatArray
) -> None:
    """Makes m the leader of n if it is on its path, nearer than the leader known."""
    half = 0.5 * (agents.width[n] + agents.width[m]) + BESIDE_M
    bumpers = 0.5 * (agents.length[n] + agents.length[m])
    row = min(max(int(s / SPACING_M), 0), PATH_POINTS - 2)
    until = min(float(PATH_POINTS), (s + gap[n] + bumpers) / SPACING_M + 1.0)
    x, y, points = now[m, 0], now[m, 1], way.points[n]
    while row < until:
        dx, dy = x - points[row, 0], y - points[row, 1]
        spare = math.sqrt(dx * dx + dy * dy) - half - SPACING_M
        if spare > 0.0:  # a point is at most 2 m nearer than the one before it
            row += max(int(spare / SPACING_M), 1)
            continue
        cos, sin = points[row, 2], points[row, 3]
        along = dx * cos + dy * sin
        if abs(along) > SPACING_M or abs(dy * cos - dx * sin) > half:
            row += 1
            continue
        at = row * SPACING_M + along
        free = at - s - bumpers
        if at > s and free < gap[n]:
            leader[n], gap[n] = m, free
        return
