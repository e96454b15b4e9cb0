"""Rules: the thesis's safety heuristic over simulator information, a layer that can be switched off.

The network drives; the rules only brake, or weaken the throttle: at red and yellow lights, and before vehicles, people
and construction in the way ahead. That lights are obeyed is therefore no skill of the network's.

Source: Coelho 2024, section 5.3; the distances are those of its code. It measures between centres: we take the gap
before the bumper and add half a car, so that a bus is no nearer than it looks. Ours: the distance grows with what the
ego needs to brake to the other's speed, the way ahead is the route, moved to where the ego is, and a light is braked
for as hard as its distance asks, so that the ego does not stand far before the line.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from dohyo.agents.priboot.measurements import TARGET_M
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.sensors import Observation
from dohyo.sumo_networks.sensors.path import BEHIND
from dohyo.sumo_networks.world import ActorKind, LightState

SENSORS: Final = ("objects", "junctions_ahead")
BANDS: Final = {"vehicle": (7.0, 15.0), "pedestrian": (5.5, 12.5), "construction": (4.0, 5.0)}
"""Distance of the hard stop, and distance from which the throttle is weakened, m."""
BRAKING, COMFORTABLE, HARDEST_YELLOW = 5.0, 2.5, 3.5
"""Decelerations: towards others, from which on it brakes for a line, and the largest for a yellow light, m/s^2."""
LINE_M, MARGIN_M = 1.5, 0.3
"""Distance to a stop line at which the ego stands, and width added on each side of the ego."""
_VEHICLE = VehicleParameters()
_CLASS = {int(ActorKind.PEDESTRIAN): "pedestrian", int(ActorKind.STATIC): "construction"}


class Verdict(NamedTuple):
    """What the rules ask for.

    Attributes:
        throttle: Factor on the throttle, in [0, 1].
        brake: Least brake, in [0, 1].
        cause: The rule; "" if none asks for anything.
    """

    throttle: float
    brake: float
    cause: str


FREE: Final = Verdict(1.0, 0.0, "")


def judge(observation: Observation, speed: float) -> Verdict:
    """The strictest rule."""
    verdicts = [_lights(observation["junctions_ahead"], speed), *_others(observation, speed), FREE]
    return min(verdicts, key=lambda verdict: (-verdict.brake, verdict.throttle))


def _lights(junctions: Float32Array, speed: float) -> Verdict:
    """Brakes for red lines as hard as it takes, and for yellow ones where that is not hard."""
    for distance, _, signal, _ in junctions.tolist():
        if not -0.5 <= distance < 1000.0 or signal not in (LightState.RED, LightState.YELLOW):
            continue
        needed = speed**2 / (2 * max(distance - LINE_M, 0.1))
        if signal == LightState.YELLOW and needed > HARDEST_YELLOW:
            continue
        if distance < LINE_M or needed > COMFORTABLE:
            return Verdict(0.0, 1.0 if distance < LINE_M else min(needed / _VEHICLE.max_braking, 1.0), "light")
    return FREE


def _others(observation: Observation, speed: float) -> list[Verdict]:
    """A verdict for each other actor in the way."""
    objects, way = observation["objects"], way_ahead(observation["path"])
    out = []
    for kind, x, y, heading, their_speed, length, width, _ in objects[objects[:, 0] >= 0].tolist():
        if x < -_VEHICLE.length or math.hypot(x, y) > TARGET_M + length:
            continue
        gap = gap_on(way, x, y, heading, length, width)
        if gap is None:
            continue
        name = _CLASS.get(int(kind), "vehicle")
        closing = max(speed - max(their_speed * math.cos(heading), 0.0), 0.0)
        stop, free = (bound + closing**2 / (2 * BRAKING) for bound in BANDS[name])
        distance = gap + _VEHICLE.length / 2
        if distance < stop:
            out.append(Verdict(0.0, 1.0, name))
        elif distance < free:
            out.append(Verdict((distance - stop) / (free - stop), 0.0, name))
    return out


def way_ahead(path: Float32Array) -> Float32Array:
    """(31, 2) the route's next 30 m, moved sideways to begin at the ego."""
    points = path[BEHIND : BEHIND + TARGET_M + 1, :2]
    return np.asarray(points - points[0], dtype=np.float32)


def gap_on(way: Float32Array, x: float, y: float, heading: float, length: float, width: float) -> float | None:
    """Free distance before the front bumper to a box, along the way, m; None if the box is not in the way."""
    cos, sin = math.cos(heading), math.sin(heading)
    u, v = np.array([1, 1, -1, -1, 0]) * length / 2, np.array([1, -1, 1, -1, 0]) * width / 2
    corners = np.column_stack([x + u * cos - v * sin, y + u * sin + v * cos])
    apart = np.linalg.norm(way[:, None] - corners[None], axis=2)
    near = apart.argmin(axis=0)
    along = np.diff(way, axis=0, append=2 * way[-1:] - way[-2:-1])
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-6)
    offset = corners - way[near]
    across = along[near, 0] * offset[:, 1] - along[near, 1] * offset[:, 0]
    forward = near + (along[near] * offset).sum(axis=1)
    reach = _VEHICLE.width / 2 + MARGIN_M
    if across.min() > reach or across.max() < -reach or forward.max() < 0.0 or forward.min() >= TARGET_M:
        return None
    return max(float(forward.min()) - _VEHICLE.length / 2, 0.0)


def straight_ahead(path: Float32Array, metres: float, most: float) -> bool:
    """Whether the route's next metres turn by less than an angle [rad] from the ego's heading."""
    x, y = way_ahead(path)[math.ceil(metres)]
    return bool(abs(math.atan2(y, x)) < most)
