"""Approaches: where an ego that has left its route's edges, such as to overtake, comes to the next junction.

SUMO's drivers yield to who approaches a junction on an edge that leads into it. An oncoming lane is on an edge that
leads away, so beside an ego there a second proxy drives on its route.
"""

from __future__ import annotations

import math

from dohyo.sumo_networks.routes.route import Route

APPROACH_M = 100.0
BESIDE_M = 12.0
ALIGNED_RAD = 1.0
_WINDOW_M = 3.0
RoadPlace = tuple[int, tuple[float, float], float]
"""Lane, x and y [m], and direction [rad]."""


def approach(route: Route, front: tuple[float, float], heading: float, inside: bool) -> RoadPlace | None:
    """Place on its route beside an ego that comes to a junction.

    Args:
        route: Route of the ego.
        front: x, y of the ego's front, m, network frame.
        heading: Heading of the ego, rad.
        inside: Whether the ego may be inside a junction already.

    Returns:
        Lane, x and y [m], and direction [rad]; None if the ego is more than 12 m from its route, does not drive along
        it, or has no junction within 100 m ahead.
    """
    apart = ((route.position - front) ** 2).sum(axis=1)
    row, spacing = int(apart.argmin()), route.length / (len(route.position) - 1)
    if apart[row] > BESIDE_M**2:
        return None
    s, _, direction = route.project(*front, row * spacing, _WINDOW_M, _WINDOW_M)
    if math.cos(heading - direction) < math.cos(ALIGNED_RAD):
        return None
    if not any(s < (one.exit if inside else one.entry) and one.entry < s + APPROACH_M for one in route.passages):
        return None
    row = min(int(s / spacing), len(apart) - 2)
    x, y = (route.position[row] + (s / spacing - row) * (route.position[row + 1] - route.position[row])).tolist()
    return route.lane.item(route.index(s)), (x, y), direction
