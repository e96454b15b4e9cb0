"""What the network is told of the features: every polyline in its own frame, and all pairs in that of their agent.

The same as `MotionNetwork.forward` works out before `futures`, of one scene and in numba: in ONNX Runtime these many
small steps on large arrays took longer than the network itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from dohyo.agents.mcts.kernels import inlined, kernel
from dohyo.agents.mcts.predictors.dataset import FUTURE_STEPS
from dohyo.agents.mcts.predictors.features import AGENT_ATTRIBUTES, LANE_ATTRIBUTES
from dohyo.agents.planning.scene import HISTORY
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.sensors.lanes import POINTS

PAST, PLAN, SHAPE, PAIR = 5 + HISTORY + AGENT_ATTRIBUTES, 7, 4 + LANE_ATTRIBUTES, 12
REACH_M = 20.0
STEP_SCALE, SEGMENT_SCALE = 4.0, 10.0
NEAR_AGENT_M, FAR_AGENT_M = 3.0, 15.0
NEAR_LANE_M, FAR_LANE_M = 2.0, 10.0
TINY_M = 1e-3

SHAPES: Final[Mapping[str, tuple[str | int, ...]]] = MappingProxyType(
    {
        "past": ("agents", HISTORY, PAST),
        "plan": ("agents", FUTURE_STEPS, PLAN),
        "shape": ("lanes", POINTS - 1, SHAPE),
        "between": ("agents", "agents", PAIR),
        "along": ("agents", "lanes", PAIR),
        "rolled": ("agents", FUTURE_STEPS, 3),
        "agents_valid": ("agents",),
        "lanes_valid": ("lanes",),
    }
)
"""The inputs of the exported network, all float32.

past: the history, its flags and times, and the agent's attributes.
plan: the roll-out's places, steps, directions and times.
shape: a lane's segments and their steps, from its first point on, towards its last; and its attributes.
between: another agent's place, direction, distance, closeness, relative and own velocity.
along: a lane's nearest point, its direction, distance, closeness, the lane's end, its direction, and which point is
nearest.
"""

PASSED: Final = ("rolled", "agents_valid", "lanes_valid")


def sized(agents: int, lanes: int) -> dict[str, tuple[int, ...]]:
    """Shapes of the inputs for some agents and lanes."""
    count = {"agents": agents, "lanes": lanes}
    return {name: tuple(n if isinstance(n, int) else count[n] for n in shape) for name, shape in SHAPES.items()}


def described(features: Mapping[str, Float32Array]) -> dict[str, Float32Array]:
    """The exported network's inputs for the features of one scene."""
    sizes = sized(agents=len(features["agents"]), lanes=len(features["lanes"]))
    out = {name: features[name] if name in PASSED else np.empty(sizes[name], dtype=np.float32) for name in SHAPES}
    history, agents, points, lanes = (features[name] for name in ("history", "agents", "points", "lanes"))
    _polylines(
        history, features["history_valid"], agents, out["rolled"], points, lanes, out["past"], out["plan"], out["shape"]
    )
    _pairs(history, agents, points, out["between"], out["along"])
    return out


@inlined
def _turned(x: float, y: float, cos: float, sin: float) -> tuple[float, float]:
    """A vector in the frame whose x axis is given as cosine and sine."""
    return x * cos + y * sin, y * cos - x * sin


@kernel
def _polylines(
    history: Float32Array,
    valid: Float32Array,
    agents: Float32Array,
    rolled: Float32Array,
    points: Float32Array,
    lanes: Float32Array,
    past: Float32Array,
    plan: Float32Array,
    shape: Float32Array,
) -> None:
    """Writes histories, roll-outs and lanes, each in its own frame."""
    times = history.shape[1]
    for a in range(history.shape[0]):
        px, py, heading = history[a, -1, 0], history[a, -1, 1], history[a, -1, 2]
        cos, sin = math.cos(heading), math.sin(heading)
        for t in range(times):
            row, turn = past[a, t], history[a, t, 2] - heading
            x, y = _turned(history[a, t, 0] - px, history[a, t, 1] - py, cos, sin)
            row[0], row[1], row[2], row[3], row[4] = (
                x / REACH_M,
                y / REACH_M,
                math.cos(turn),
                math.sin(turn),
                valid[a, t],
            )
            for k in range(times):
                row[5 + k] = 1.0 if k == t else 0.0
            for k in range(agents.shape[1]):
                row[5 + times + k] = agents[a, k]
        before_x, before_y = 0.0, 0.0
        for t in range(rolled.shape[1]):
            row, turn = plan[a, t], rolled[a, t, 2] - heading
            x, y = _turned(rolled[a, t, 0] - px, rolled[a, t, 1] - py, cos, sin)
            x, y = x / REACH_M, y / REACH_M
            row[0], row[1] = x, y
            row[2], row[3] = (x - before_x) * STEP_SCALE, (y - before_y) * STEP_SCALE
            row[4], row[5], row[6] = math.cos(turn), math.sin(turn), t / rolled.shape[1]
            before_x, before_y = x, y
    for n in range(points.shape[0]):
        x0, y0 = points[n, 0, 0], points[n, 0, 1]
        dx, dy = points[n, -1, 0] - x0, points[n, -1, 1] - y0
        far = max(math.sqrt(dx * dx + dy * dy), TINY_M)
        cos, sin, x, y = dx / far, dy / far, 0.0, 0.0
        for k in range(points.shape[1] - 1):
            row = shape[n, k]
            after_x, after_y = _turned(points[n, k + 1, 0] - x0, points[n, k + 1, 1] - y0, cos, sin)
            after_x, after_y = after_x / REACH_M, after_y / REACH_M
            row[0], row[1] = x, y
            row[2], row[3] = (after_x - x) * SEGMENT_SCALE, (after_y - y) * SEGMENT_SCALE
            for i in range(lanes.shape[1]):
                row[4 + i] = lanes[n, i]
            x, y = after_x, after_y


@kernel
def _pairs(
    history: Float32Array, agents: Float32Array, points: Float32Array, between: Float32Array, along: Float32Array
) -> None:
    """Writes where the other agents and the lanes are to each agent."""
    for a in range(history.shape[0]):
        px, py, speed = history[a, -1, 0], history[a, -1, 1], agents[a, 0]
        cos, sin = math.cos(history[a, -1, 2]), math.sin(history[a, -1, 2])
        for b in range(history.shape[0]):
            row, heading = between[a, b], history[b, -1, 2]
            x, y = _turned(history[b, -1, 0] - px, history[b, -1, 1] - py, cos, sin)
            turn_x, turn_y = _turned(math.cos(heading), math.sin(heading), cos, sin)
            far = max(math.sqrt(x * x + y * y), TINY_M)
            row[0], row[1], row[2], row[3], row[4] = x / REACH_M, y / REACH_M, turn_x, turn_y, far / REACH_M
            row[5], row[6] = math.exp(-far / NEAR_AGENT_M), math.exp(-far / FAR_AGENT_M)
            row[9], row[10], row[11] = turn_x * agents[b, 0], turn_y * agents[b, 0], 1.0
            row[7], row[8] = row[9] - speed, row[10]
        for n in range(points.shape[0]):
            row, lane, last = along[a, n], points[n], points.shape[1] - 1
            nearest, least = 0, math.inf
            for k in range(last + 1):
                dx, dy = lane[k, 0] - px, lane[k, 1] - py
                if dx * dx + dy * dy < least:
                    nearest, least = k, dx * dx + dy * dy
            far = max(math.sqrt(least), TINY_M)
            x, y = _turned(lane[nearest, 0] - px, lane[nearest, 1] - py, cos, sin)
            row[0], row[1] = x / REACH_M, y / REACH_M
            row[2], row[3] = _direction(lane, min(nearest, last - 1), cos, sin)
            row[4], row[5], row[6] = far / REACH_M, math.exp(-far / NEAR_LANE_M), math.exp(-far / FAR_LANE_M)
            x, y = _turned(lane[last, 0] - px, lane[last, 1] - py, cos, sin)
            row[7], row[8] = x / REACH_M, y / REACH_M
            row[9], row[10] = _direction(lane, last - 1, cos, sin)
            row[11] = nearest / last


@kernel
def _direction(lane: Float32Array, k: int, cos: float, sin: float) -> tuple[float, float]:
    """Direction of the segment from a point on, in a frame."""
    dx, dy = lane[k + 1, 0] - lane[k, 0], lane[k + 1, 1] - lane[k, 1]
    size = max(math.sqrt(dx * dx + dy * dy), TINY_M)
    return _turned(dx / size, dy / size, cos, sin)
