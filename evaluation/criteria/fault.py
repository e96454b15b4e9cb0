"""Fault: whether the ego caused a collision, by nuPlan's tests; one rule for the criterion and for nuPlan's score."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.geometry import boxes_overlap
from dohyo.sumo_networks.networks.network import RoadNetwork

STOPPED_MPS = 0.05
BEHIND_RAD = math.radians(150.0)
BESIDE_LANE_M = 0.5
_CONNECTED_HOPS = 3


def is_at_fault(
    ego: FloatArray, speed: float, other: FloatArray, other_speed: float, *, tick_s: float, in_one_lane: bool
) -> bool:
    """Whether the ego caused a collision.

    In this order: a stopped ego did not; an ego that meets something stopped did; a hit from behind is the other's; one
    with the ego's front bumper is the ego's; any other is lateral, and the ego's unless it keeps to one lane.

    Args:
        ego: (5,) the ego's box when the two touch: x, y [m], heading [rad], length, width [m].
        speed: Of the ego, m/s.
        other: (5,) the other box.
        other_speed: m/s; 0 for static things.
        tick_s: Time since the tick in which they did not touch yet, s.
        in_one_lane: Whether the ego keeps to one lane; see `keeps_to_one_lane`.

    Source: nuPlan, no ego at-fault collision. Its bearing starts at the rear axle, this one at the box's centre; its
    bumper is where it is after the tick, this one is swept over the tick, as seen from the other: a car at 30 km/h
    would otherwise pass through a pedestrian's front to meet him with its side.
    """
    if speed <= STOPPED_MPS:
        return False
    if other_speed <= STOPPED_MPS:
        return True
    x, y, heading, length, width = ego.tolist()
    bearing = math.atan2(other[1] - y, other[0] - x) - heading
    if math.cos(bearing) < math.cos(BEHIND_RAD):
        return False
    swept = max(speed - other_speed * math.cos(other[2] - heading), 0.0) * tick_s
    ahead = (length - swept) / 2
    bumper = np.array([[x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading, swept, width]])
    if boxes_overlap(bumper, other[None])[0, 0]:
        return True
    return not in_one_lane


def keeps_to_one_lane(network: RoadNetwork, box: FloatArray, lane: int) -> bool:
    """Whether the four corners of a box are on its centre's lane, or on lanes that lead into or out of it.

    Args:
        network: The roads.
        box: (5,) x, y [m], heading [rad], length, width [m].
        lane: Lane of the box's centre, -1 where there is none.
    """
    if lane < 0:
        return False
    own = _connected(network, lane)
    x, y, heading, length, width = box.tolist()
    half, cos, sin = 0.5 * length, math.cos(heading), math.sin(heading)
    left_x, left_y = -0.5 * width * sin, 0.5 * width * cos
    for ahead, side in product((half, -half), (1.0, -1.0)):
        corner = x + ahead * cos + side * left_x, y + ahead * sin + side * left_y
        # Of the lanes that overlap inside a junction, a corner is on the ego's own if it can be.
        at, offset, _ = network.nearest_lane(*corner, heading, own)
        if at < 0 or not own[at] or abs(offset) > 0.5 * network.lanes.width[at] + BESIDE_LANE_M:
            return False
    return True


def _connected(network: RoadNetwork, lane: int) -> BoolArray:
    """(L,) the lane, those it leads to, and those that lead to it, within about a vehicle's length."""
    source, target = network.connections.source, network.connections.target
    following = np.zeros(len(network.lanes.ids), dtype=np.bool_)
    following[lane] = True
    leading = following.copy()
    for _ in range(_CONNECTED_HOPS):
        following[target[following[source]]] = True
        leading[source[leading[target]]] = True
    return following | leading
