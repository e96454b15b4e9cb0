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
BESIDE_LANE_M = 0.1
"""Largest distance of a corner from the edge of the lane that the ego keeps to, m."""
_CONNECTED_HOPS = 3


def is_at_fault(
    ego: FloatArray, speed: float, other: FloatArray, other_speed: float, *, tick_s: float, in_one_lane: bool
) -> bool:
    """Whether the ego caused a collision.

    The rules in their order: a stopped ego is not at fault; an ego that hits a stopped actor is at fault; an ego hit
    from behind is not at fault; an ego that hits with its front bumper is at fault. Any other collision is lateral, and
    the ego is at fault unless it keeps to one lane.

    Args:
        ego: (5,) box of the ego at the contact: x, y [m], heading [rad], length, width [m].
        speed: Speed of the ego, m/s.
        other: (5,) box of the other actor or object, likewise.
        other_speed: Speed of the other, m/s; 0 for static objects.
        tick_s: Time since the last tick without contact, s.
        in_one_lane: Whether the ego keeps to one lane; see `keeps_to_one_lane`.

    Source: nuPlan, no ego at-fault collision. nuPlan takes the bearing from the rear axle, dohyo from the centre of
    the box. nuPlan tests the bumper after the tick, dohyo sweeps it over the tick, in the frame of the other. Otherwise
    a car at 30 km/h could pass through a pedestrian within a tick and touch him only with its side.
    """
    if speed <= STOPPED_MPS:
        return False
    if other_speed <= STOPPED_MPS:
        return True
    x, y, heading = ego[:3].tolist()
    bearing = math.atan2(other[1] - y, other[0] - x) - heading
    if math.cos(bearing) < math.cos(BEHIND_RAD):
        return False
    return hits_with_bumper(ego, speed, other, other_speed, tick_s=tick_s) or not in_one_lane


def hits_with_bumper(ego: FloatArray, speed: float, other: FloatArray, other_speed: float, *, tick_s: float) -> bool:
    """Whether the ego's front bumper swept over the other one in the last tick, in the frame of the other.

    Args:
        ego: (5,) box of the ego after the tick: x, y [m], heading [rad], length, width [m].
        speed: Speed of the ego, m/s.
        other: (5,) box of the other actor or object, likewise.
        other_speed: Speed of the other, m/s.
        tick_s: Length of the tick, s.
    """
    x, y, heading, length, width = ego.tolist()
    swept = max(approach_mps(heading, speed, other, other_speed), 0.0) * tick_s
    ahead = (length - swept) / 2
    bumper = np.array([[x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading, swept, width]])
    return bool(boxes_overlap(bumper, other[None])[0, 0])


def approach_mps(heading: float, speed: float, other: FloatArray, other_speed: float) -> float:
    """The ego's speed along its heading [rad] as the other one sees it, m/s; negative: the other one drives ahead."""
    return speed - other_speed * math.cos(other.item(2) - heading)


def keeps_to_one_lane(network: RoadNetwork, box: FloatArray, lane: int) -> bool:
    """Whether the four corners of a box are on the lane of its centre, or on lanes that lead into or out of that lane.

    Args:
        network: Network with the lanes.
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
        # Inside a junction lanes overlap: a corner that is on several lanes counts as on the ego's own.
        at, offset, _ = network.nearest_lane(*corner, heading, own)
        if at < 0 or not own[at] or abs(offset) > 0.5 * network.lanes.width[at] + BESIDE_LANE_M:
            return False
    return True


def _connected(network: RoadNetwork, lane: int) -> BoolArray:
    """(L,) the lane itself, its successors and its predecessors, within about the length of a vehicle."""
    source, target = network.connections.source, network.connections.target
    following = np.zeros(len(network.lanes.ids), dtype=np.bool_)
    following[lane] = True
    leading = following.copy()
    for _ in range(_CONNECTED_HOPS):
        following[target[following[source]]] = True
        leading[source[leading[target]]] = True
    return following | leading
