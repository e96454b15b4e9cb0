"""Stop lines: those that an ego's motion crosses, and the distance of a point from one."""

from __future__ import annotations

import math

from dohyo.sumo_networks.world import Egos, World

Point = tuple[float, float]


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


def distance_to_line(x: float, y: float, right_x: float, right_y: float, left_x: float, left_y: float) -> float:
    """Distance of a point from the straight line through two others, m."""
    along_x, along_y = left_x - right_x, left_y - right_y
    return abs(along_x * (y - right_y) - along_y * (x - right_x)) / math.hypot(along_x, along_y)
