"""Hybrid A* (Dolgov et al. 2008): paths of a kart between boxes, on a grid of poses that keeps continuous ones.

Each expansion tries curves to the goal; without reverse, Dubins curves that end straight, so that the kart enters a
spot aligned. The length of the shortest curve without obstacles is the heuristic.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from dohyo.agents.parking.expert.curves import advanced, poses_along
from dohyo.agents.parking.expert.shortest import shortest_curve
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.geometry import box_overlaps

CELL_M, HEADINGS = 0.5, 24
"""Cell of the grid, and its number of headings."""
STRIDE_M, SAMPLE_M = 0.7, 0.15
"""Length of an edge, and distance of the poses that are checked."""
STRAIGHTS_M = (0.0, 0.8, 1.6, 2.4)
"""Lengths of the straight end of a curve to the goal, m."""
STRAIGHT_COST = 5.0
"""Cost of each metre by which a curve's end is less than the longest straight: a kart needs some way to align."""
REVERSE_COST, SWITCH_COST_M = 1.5, 2.0
"""Factor of the length in reverse, and cost of a change of direction."""


class Shape(NamedTuple):
    """A kart, for the planner.

    Attributes:
        radius: Turning radius of the reference point, m.
        front: From the reference point to the front, m.
        rear: From the reference point to the rear, m.
        half_width: m.
    """

    radius: float
    front: float
    rear: float
    half_width: float

    def padded(self, margin: float) -> Shape:
        """The shape with a margin on all sides, m."""
        return Shape(self.radius, self.front + margin, self.rear + margin, self.half_width + margin)


@njit(cache=True)
def touches(x: float, y: float, heading: float, shape: Shape, boxes: FloatArray) -> bool:
    """Whether a kart at a pose overlaps a box.

    Args:
        x: m.
        y: m.
        heading: rad.
        shape: Of the kart.
        boxes: (B, 5) of `dohyo.sumo_networks.geometry`.
    """
    ahead = 0.5 * (shape.front - shape.rear)
    kart = np.empty(5)
    kart[0], kart[1], kart[2] = x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading
    kart[3], kart[4] = shape.front + shape.rear, 2.0 * shape.half_width
    for i in range(len(boxes)):  # noqa: SIM110 - numba compiles no generator expression
        if box_overlaps(kart, boxes[i]):
            return True
    return False


@njit(cache=True)
def plan(
    start: FloatArray, goal: FloatArray, boxes: FloatArray, shape: Shape, reverse: bool, expansions: int
) -> FloatArray:
    """Path between two poses.

    Args:
        start: (3,) x, y [m] and heading [rad].
        goal: (3,) likewise.
        boxes: See `touches`; walls are thin ones.
        shape: Of the kart, with its margin.
        reverse: Whether the kart may drive in reverse.
        expansions: Upper bound of the expanded nodes.

    Returns:
        (P, 5) poses, see `poses_along`; empty without a path.
    """
    path = _shot(start, goal, boxes, shape, reverse)
    if len(path) or touches(goal[0], goal[1], goal[2], shape, boxes):
        return path
    nodes, links, cost = np.empty((6 * expansions + 1, 3)), np.full((6 * expansions + 1, 2), -1), [0.0]
    nodes[0], links[0, 1] = start, 1
    best = {_key(start): 0.0}
    queue = [(_ahead(start, goal, shape.radius, reverse), 0)]
    for _ in range(expansions):
        if not queue:
            break
        _, node = heapq.heappop(queue)
        if cost[node] > best[_key(nodes[node])]:
            continue
        shot = _shot(nodes[node], goal, boxes, shape, reverse)
        if len(shot):
            return _traced(nodes, links, node, shot, shape.radius)
        for edge in range(6 if reverse else 3):
            steering, direction = float(edge % 3 - 1), 1 if edge < 3 else -1
            after = _driven(nodes[node], steering, direction, boxes, shape)
            if after[3] == 0.0:
                continue
            price = cost[node] + STRIDE_M * (1.0 if direction > 0 else REVERSE_COST) + 0.05 * abs(steering)
            if direction != links[node, 1]:
                price += SWITCH_COST_M
            key = _key(after)
            if key in best and best[key] <= price:
                continue
            best[key], count = price, len(cost)
            nodes[count], links[count, 0], links[count, 1] = after[:3], node, direction
            cost.append(price)
            heapq.heappush(queue, (price + _ahead(after[:3], goal, shape.radius, reverse), count))
    return np.zeros((0, 5))


@njit(cache=True)
def _key(pose: FloatArray) -> tuple[int, int, int]:
    """Cell of a pose."""
    turn = round(pose[2] / (2.0 * math.pi) * HEADINGS) % HEADINGS
    return math.floor(pose[0] / CELL_M), math.floor(pose[1] / CELL_M), turn


@njit(cache=True)
def _ahead(pose: FloatArray, goal: FloatArray, radius: float, reverse: bool) -> float:
    """Heuristic: length of the shortest curve without obstacles."""
    return shortest_curve(pose, goal, radius, reverse)[0]


@njit(cache=True)
def _driven(start: FloatArray, steering: float, direction: int, boxes: FloatArray, shape: Shape) -> FloatArray:
    """(4,) pose at the end of an edge, and whether the way is free."""
    end = np.zeros(4)
    pieces, radius = math.ceil(STRIDE_M / SAMPLE_M), shape.radius
    for piece in range(1, pieces + 1):
        length = direction * STRIDE_M / radius * piece / pieces
        x, y, heading = advanced(start[0] / radius, start[1] / radius, start[2], steering, length)
        end[0], end[1], end[2] = x * radius, y * radius, heading
        if touches(end[0], end[1], heading, shape, boxes):
            return end
    end[3] = 1.0
    return end


@njit(cache=True)
def _shot(start: FloatArray, goal: FloatArray, boxes: FloatArray, shape: Shape, reverse: bool) -> FloatArray:
    """Shortest free curve to the goal; empty without one."""
    best, found = math.inf, np.zeros((0, 5))
    for straight in STRAIGHTS_M:
        before = goal.copy()
        before[0] -= straight * math.cos(goal[2])
        before[1] -= straight * math.sin(goal[2])
        length, curve = shortest_curve(start, before, shape.radius, reverse)
        price = length + straight + STRAIGHT_COST * (STRAIGHTS_M[-1] - straight)
        if price >= best:
            continue
        poses = poses_along(start, curve, shape.radius, SAMPLE_M)
        if straight > 0.0:
            end = np.zeros_like(curve)
            end[0, 1] = straight / shape.radius
            poses = np.concatenate((poses, poses_along(before, end, shape.radius, SAMPLE_M)[1:]))
        if _free(poses, shape, boxes):
            best, found = price, poses
    return found


@njit(cache=True)
def _free(poses: FloatArray, shape: Shape, boxes: FloatArray) -> bool:
    """Whether a kart touches nothing at any pose, the last ones first, since they are the narrow ones."""
    for i in range(len(poses) - 1, -1, -1):  # noqa: SIM110 - numba compiles no generator expression
        if touches(poses[i, 0], poses[i, 1], poses[i, 2], shape, boxes):
            return False
    return True


@njit(cache=True)
def _traced(nodes: FloatArray, links: IntArray, node: int, shot: FloatArray, radius: float) -> FloatArray:
    """Path over the nodes that lead to `node`, and the curve from there."""
    path = shot
    while links[node, 0] >= 0:
        before = links[node, 0]
        curve, best = np.zeros((5, 2)), math.inf
        for steering in (-1.0, 0.0, 1.0):
            length = links[node, 1] * STRIDE_M / radius
            x, y, _ = advanced(nodes[before, 0] / radius, nodes[before, 1] / radius, nodes[before, 2], steering, length)
            away = abs(x * radius - nodes[node, 0]) + abs(y * radius - nodes[node, 1])
            if away < best:
                best, curve[0, 0], curve[0, 1] = away, steering, length
        path = np.concatenate((poses_along(nodes[before], curve, radius, SAMPLE_M)[:-1], path))
        node = before
    return path
