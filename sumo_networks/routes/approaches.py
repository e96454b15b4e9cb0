"""Approaches: where an ego that has left its route's edges, such as to overtake, comes to the next junction.

SUMO's drivers yield to who approaches a junction on an edge that leads into it. An oncoming lane is on an edge that
leads away, so beside an ego there a second proxy drives on its route.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dohyo.sumo_networks.routes.route import Route

APPROACH_M = 100.0
BESIDE_M = 12.0
ALIGNED_RAD = 1.0
NEIGHBOURHOOD_M = 20.0
_WINDOW_M = 3.0


class Approach(NamedTuple):
    """Place on its route beside an ego that comes to a junction.

    Attributes:
        lane: Lane of the route.
        x: x, m, network frame.
        y: y, m.
        direction: Direction of the route, rad.
        lanes: Lanes of the route up to 20 m before and behind the place.
    """

    lane: int
    x: float
    y: float
    direction: float
    lanes: tuple[int, ...]


def approach(route: Route, front: tuple[float, float], heading: float, inside: bool) -> Approach | None:
    """The place beside an ego on its route, if the ego comes to a junction.

    Args:
        route: Route of the ego.
        front: x, y of the ego's front, m, network frame.
        heading: Heading of the ego, rad.
        inside: Whether the ego may be inside a junction already.

    Returns:
        The place; None if the ego does not drive along its route within 12 m of it, or has no junction within 100 m
        ahead.
    """
    apart = ((route.position - front) ** 2).sum(axis=1)
    # A leg of the route that crosses here, or leads back beside this one, may be nearer.
    apart[np.cos(route.heading - heading) < math.cos(ALIGNED_RAD)] = math.inf
    row, spacing = int(apart.argmin()), route.length / (len(route.position) - 1)
    if apart[row] > BESIDE_M**2:
        return None
    s, _, direction = route.project(*front, row * spacing, _WINDOW_M, _WINDOW_M)
    if not any(s < (one.exit if inside else one.entry) and one.entry < s + APPROACH_M for one in route.passages):
        return None
    row = min(int(s / spacing), len(apart) - 2)
    x, y = (route.position[row] + (s / spacing - row) * (route.position[row + 1] - route.position[row])).tolist()
    lanes = route.lane[route.index(s - NEIGHBOURHOOD_M) : route.index(s + NEIGHBOURHOOD_M) + 1]
    return Approach(route.lane.item(route.index(s)), x, y, direction, tuple(dict.fromkeys(lanes.tolist())))
