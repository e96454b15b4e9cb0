"""The tree as JSON: tried actions, their values, and the reasons."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from dohyo.agents.mcts.config import ACTIONS, MIDDLE, Rules
from dohyo.agents.mcts.simulator import (
    ACCELERATION,
    DEMAND,
    FAILED,
    HEADING,
    LATERAL,
    SPEED,
    STEERING,
    TERM_NAMES,
    S,
    X,
    Y,
    controls,
)
from dohyo.agents.mcts.tree import NODES, Tree
from dohyo.agents.planning.motion import Body, project, vehicle_step
from dohyo.agents.planning.situation import Situation
from dohyo.sumo_networks.arrays import FloatArray

MOST_NODES = 600


def explain_search(tree: Tree, road: Situation, car: Body, rules: Rules) -> dict[str, Any]:
    """Most visited nodes, each after its parent.

    Returns:
        frame: Frame of the trajectories.
        root: N and Q.
        nodes: Of each the number, its parent's, depth, action (acceleration [m/s^2] and steering), N, Q, P, the best
            return of a rollout through it, rollouts through it that reached the horizon, whether it failed, speed
            [m/s], the terms of its reward, and the trajectory [m] of the box centre every 0.1 s of its action.
    """
    count = int(tree.numbers[NODES])
    order = np.lexsort((np.arange(1, count), -tree.visits[1:count]))[:MOST_NODES] + 1
    keep = np.sort(order)  # parents are made before their children, and visited at least as often
    kept = set(keep.tolist()) | {0}
    nodes = [_node(tree, road, car, rules, int(i)) for i in keep if int(tree.parent[i]) in kept]
    return {
        "frame": "the ego's: box centre, x forward, y left",
        "steering": "lines beside the route, m" if rules.lane_steering else "front wheel angle, rad",
        "root": {"n": int(tree.visits[0]), "q": _rounded(tree.value[0])},
        "nodes": nodes,
    }


def _node(tree: Tree, road: Situation, car: Body, rules: Rules, i: int) -> dict[str, Any]:
    a, b = divmod(int(tree.action[i]), ACTIONS)
    points = np.zeros((rules.hold_steps + 1, 2))
    state = tree.state[int(tree.parent[i])].copy()
    _trace(road, car, rules, state, (a - MIDDLE) * rules.acceleration_step, (b - MIDDLE) * rules.steering_step, points)
    return {
        "node": i,
        "parent": int(tree.parent[i]),
        "depth": int(tree.depth[i]),
        "acceleration": (a - MIDDLE) * rules.acceleration_step,
        "steering": _rounded((b - MIDDLE) * rules.steering_step),
        "n": int(tree.visits[i]),
        "q": _rounded(tree.value[i]),
        "p": _rounded(tree.prior[i], 5),
        "best": _rounded(tree.best[i]),
        "perfect": int(tree.perfect[i]),
        "failed": bool(tree.outcome[i] == FAILED),
        "speed": _rounded(tree.state[i, SPEED]),
        "reward": {name: _rounded(v) for name, v in zip(TERM_NAMES, tree.terms[i], strict=True) if v != 0.0},
        "trajectory": points.round(2).tolist(),
    }


def _rounded(value: float, digits: int = 3) -> float:
    return round(float(value), digits)


@njit(cache=True, error_model="numpy")
def _trace(
    road: Situation, car: Body, rules: Rules, state: FloatArray, target: float, lateral: float, points: FloatArray
) -> None:
    """Path of the box centre while an action is held; as `simulator.advance`, without rewards."""
    for step in range(points.shape[0]):
        cos, sin = math.cos(state[HEADING]), math.sin(state[HEADING])
        points[step, 0], points[step, 1] = state[X] + car.axle * cos, state[Y] + car.axle * sin
        near = state[S] + 0.1 * state[SPEED] if step else state[S]
        s, side, _ = project(road.path, road.first_s, road.spacing, points[step, 0], points[step, 1], near, 4.0)
        if step:
            state[S], state[LATERAL] = s, side
        demand, wheel = controls(road, car, rules, state, target, lateral)
        state[DEMAND] = demand
        moved = vehicle_step(
            car, state[X], state[Y], state[HEADING], state[SPEED], state[ACCELERATION], state[STEERING], demand, wheel
        )
        state[X], state[Y], state[HEADING], state[SPEED], state[ACCELERATION], state[STEERING] = moved
