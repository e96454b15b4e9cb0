"""Stop lines: those that an ego's motion crosses or that it passes beside its road, and the distance from one."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.world import Egos, World

Point = tuple[float, float]
BESIDE_M: Final = 10.0
"""Largest distance beside its road at which an ego still passes the stop lines of the road."""


def axis_point(egos: Egos, ego: int, ahead: float) -> Point:
    """Point on an ego's longitudinal axis.

    Args:
        egos: All egos.
        ego: Index of the ego.
        ahead: Distance ahead of the box centre, m; negative behind.

    Returns:
        x, y, m, network frame.
    """
    heading = egos.heading.item(ego)
    x, y = egos.position[ego].tolist()
    return x + ahead * math.cos(heading), y + ahead * math.sin(heading)


def front(egos: Egos, ego: int) -> Point:
    """Middle of an ego's front bumper, m, network frame."""
    return axis_point(egos, ego, 0.5 * egos.length.item(ego))


def crossed_stop_lines(world: World, ego: int, start: Point, end: Point) -> list[int]:
    """Stop lines that a motion of the ego crosses in driving direction.

    Networks have no heights: a road may pass over or under the stop line of another road. For an ego on its route only
    the stop lines of the route and of the current edge therefore count.

    Args:
        world: The world after the motion.
        ego: Index of the ego.
        start: Start of the motion, m, network frame.
        end: End of the motion, m, network frame.

    Returns:
        Rows of `RoadNetwork.stop_lines`.
    """
    rows = world.network.crossed_stop_lines(*start, *end)
    if not len(rows):
        return []
    lanes, on_route = world.network.lanes, world.routes[ego].on_route
    here = world.egos.lane.item(ego)
    if here < 0 or lanes.internal[here] or not on_route[here]:
        return [int(row) for row in rows]
    guarded = world.network.stop_lines.lane[rows]
    meets = on_route[guarded] | (lanes.edge[guarded] == lanes.edge[here])
    return [int(row) for row in rows[meets]]


def passed_stop_lines(before: World, after: World, ego: int) -> list[int]:
    """Stop lines of an ego's route that its front passes beside all lanes of the road, such as on a cycle path.

    Without them a light could be passed on the verge, for a stop line is as wide as its lane.

    Returns:
        Rows of `RoadNetwork.stop_lines`.
    """
    half = 0.5 * after.egos.length.item(ego)
    start, end = before.egos.progress.item(ego) + half, after.egos.progress.item(ego) + half
    network, point = after.network, front(after.egos, ego)
    lanes = [
        network.connections.source.item(passage.connection)
        for passage in after.routes[ego].passages
        if start < passage.entry <= end
    ]
    guarded = network.stop_lines.lane
    return [
        int(np.searchsorted(guarded, lane)) for lane in lanes if lane in guarded and _is_beside(network, lane, point)
    ]


def _is_beside(network: RoadNetwork, lane: int, point: Point) -> bool:
    """Whether a point is beside all lanes of a lane's road at their end, by at most `BESIDE_M`."""
    lanes = network.lanes
    road = np.flatnonzero((lanes.edge == lanes.edge[lane]) & lanes.drivable)
    ends, before = lanes.points[lanes.start[road + 1] - 1], lanes.points[lanes.start[road + 1] - 2]
    along, away = ends - before, np.array(point) - ends
    area, length = np.abs(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0]), np.hypot(along[:, 0], along[:, 1])
    # The distance from its end, where a lane has no direction there.
    across = np.divide(area, length, out=np.hypot(away[:, 0], away[:, 1]), where=length > 0.0)
    beyond = float((across - 0.5 * lanes.width[road]).min())
    return 0.0 < beyond <= BESIDE_M


def distance_to_line(x: float, y: float, right_x: float, right_y: float, left_x: float, left_y: float) -> float:
    """Distance of a point from the straight line through two others, m."""
    along_x, along_y = left_x - right_x, left_y - right_y
    return abs(along_x * (y - right_y) - along_y * (x - right_x)) / math.hypot(along_x, along_y)
