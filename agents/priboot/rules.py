"""Rules: the thesis's safety heuristic over simulator information, a layer that can be switched off.

The network drives; the rules only brake, or weaken the throttle: at red and yellow lights, and before vehicles, people
and construction in the way ahead. That lights are obeyed is therefore no skill of the network's.

Source: Coelho 2024, section 5.3; the distances are those of its code. It measures between centres: we take the gap
before the bumper and add half of the ego and half of a usual one of its kind, so that a bus is no nearer than it looks.
Ours: the distance grows by what the ego needs to stop behind another that brakes as hard, and by what one that comes
towards it drives meanwhile; who walks or cycles goes on until the ego has stopped, a vehicle that crosses as far as it
needs to stop itself, and see `foresight`; what stands is in the way only where the network's waypoints lead into it, so
that the ego may go round, and is braked for where there is still room for that; what moves is so on the route, moved to
where the ego is, too; and a light is braked for as hard as its distance asks, so that the ego does not stand far before
the line.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from dohyo.agents.priboot.foresight import BRAKING, STANDS_M_S, must_brake
from dohyo.agents.priboot.measurements import TARGET_M
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.sensors import Observation
from dohyo.sumo_networks.sensors.path import BEHIND
from dohyo.sumo_networks.world import ActorKind, LightState

SENSORS: Final = ("objects", "junctions_ahead")
BANDS: Final = {"vehicle": (7.0, 15.0), "pedestrian": (5.5, 12.5), "construction": (4.0, 5.0)}
"""Distance of the hard stop, and distance from which the throttle is weakened, m."""
HALF: Final = {"vehicle": 2.3, "pedestrian": 0.25, "construction": 0.2}
"""Half the length of a usual one, m."""
COMFORTABLE, HARDEST_YELLOW = 2.5, 3.5
"""Decelerations from which on it brakes for a line, and the largest for a yellow light, m/s^2."""
LINE_M, MARGIN_M, MARGIN_STANDING_M, MARGIN_S = 1.5, 0.3, 0.1, 0.03
"""Distance to a stop line at which the ego stands, and width added on each side of the ego; beside cars and cones that
stand the network may drive closely, and slowly the most, m per m/s."""
SEEN_M: Final = 60
"""How far ahead on its way the ego minds others, m: two cars that come towards each other at 50 km/h need as much."""
RUN_UP_M: Final = 7.0
"""Free distance before the bumper that the ego needs to go round what stands."""
SHORTEST_M, TURNS_M = 1.0, 10.0
"""Shortest waypoints that tell where the ego goes, and length on which it turns back to the route's direction behind
them."""
SHORTEST_S, CROSSING = 1.5, 0.7
"""Time for which who is on foot or on a bicycle is taken to go on, at least, and cosine of the angle to the way from
which on a vehicle crosses it."""
_VEHICLE = VehicleParameters()
Ways = tuple[Float32Array, ...]
"""The way that the network intends, and the route, each moved to where the ego is."""
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


class Meeting(NamedTuple):
    """Where the ego meets a box on its way.

    Attributes:
        gap: Free distance before the front bumper, along the way, m.
        direction: Of the way there, rad, ego frame.
    """

    gap: float
    direction: float


def judge(observation: Observation, speed: float, waypoints: FloatArray) -> Verdict:
    """The strictest rule for an ego at a speed [m/s] that intends to follow (4, 2) waypoints [m, ego frame]."""
    verdicts = [_lights(observation["junctions_ahead"], speed), *_others(observation, speed, waypoints), FREE]
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


def _others(observation: Observation, speed: float, waypoints: FloatArray) -> list[Verdict]:
    """A verdict for each other actor near the way."""
    route = way_ahead(observation["path"], SEEN_M)
    ways = (way_intended(route, waypoints), route)
    verdicts = [_before(other, ways, speed) for other in _near(observation["objects"], ways, speed)]
    foreseen = must_brake(observation["objects"], speed, waypoints)
    return [*verdicts, Verdict(0.0, 1.0, "foreseen")] if foreseen else verdicts


def _near(objects: Float32Array, ways: Ways, speed: float) -> list[list[float]]:
    """Rows of those who may be on one of the ways before the ego has stopped."""
    there = objects[(objects[:, 0] >= 0) & (objects[:, 1] > -_VEHICLE.length)]
    apart = np.linalg.norm(there[:, None, 1:3] - np.vstack(ways)[None], axis=2).min(axis=1)
    reach = np.hypot(there[:, 5], there[:, 6]) / 2 + there[:, 4] * max(speed / BRAKING, SHORTEST_S)
    reach = np.maximum(reach, there[:, 4] ** 2 / (2 * BRAKING))
    rows: list[list[float]] = there[apart < reach + _VEHICLE.width].tolist()
    return rows


def _before(other: list[float], ways: Ways, speed: float) -> Verdict:
    """What an ego at a speed does before another one, a row of the sensor `objects`."""
    kind, _, _, heading, their_speed, *_ = other
    stands = their_speed < STANDS_M_S and kind != ActorKind.PEDESTRIAN
    met = _met(other, ways[:1] if stands else ways, stands, speed)
    if met is None:
        return FREE
    gap, direction = met
    name = _CLASS.get(int(kind), "vehicle")
    along = their_speed * math.cos(heading - direction)
    behind = max(speed**2 - max(along, 0.0) ** 2, 0.0) / (2 * BRAKING) + max(-along, 0.0) * speed / BRAKING
    stop, free = (bound + behind for bound in BANDS[name])
    distance = gap + _VEHICLE.length / 2 + HALF[name]
    needed = speed**2 / (2 * max(gap - RUN_UP_M, 0.1)) if stands and gap > RUN_UP_M else 0.0
    if distance < stop:
        return Verdict(0.0, 1.0, name)
    if needed > COMFORTABLE:
        return Verdict(0.0, min(needed / _VEHICLE.max_braking, 1.0), name)
    return Verdict((distance - stop) / (free - stop), 0.0, name) if distance < free else FREE


def _met(other: list[float], ways: Ways, stands: bool, speed: float) -> Meeting | None:
    """The first meeting with another one: where it is now, and where it goes on before the ego can stop."""
    kind, x, y, heading, their_speed, length, width, _ = other
    width += 2 * (MARGIN_STANDING_M + MARGIN_S * speed if stands else MARGIN_M)
    met = [found for way in ways if (found := meeting(way, x, y, heading, length, width)) is not None]
    if not stands:
        # A vehicle may brake for the ego; what it needs to stop it drives in any case.
        walks = kind in (ActorKind.PEDESTRIAN, ActorKind.BICYCLE)
        further = their_speed * max(speed / BRAKING, SHORTEST_S) if walks else their_speed**2 / (2 * BRAKING)
        x, y = x + further / 2 * math.cos(heading), y + further / 2 * math.sin(heading)
        ahead = (x, y, heading, length + further, width)
        later = [found for way in ways if (found := meeting(way, *ahead)) is not None]
        met += [found for found in later if walks or abs(math.cos(heading - found.direction)) < CROSSING]
    return min(met, default=None)


def way_ahead(path: Float32Array, metres: int = TARGET_M) -> Float32Array:
    """(N + 1, 2) the route's next N metres, straight on behind the goal, moved sideways to begin at the ego."""
    points = path[:, :2].copy()
    goal = int(np.flatnonzero((points != points[-1]).any(axis=1)).max(initial=-1)) + 1  # from which on it repeats
    heading = path[-1, 2]
    points[goal:] += np.arange(len(path) - goal)[:, None] * np.array([np.cos(heading), np.sin(heading)])
    points = points[BEHIND : BEHIND + metres + 1]
    return np.asarray(points - points[0], dtype=np.float32)


def way_intended(route: Float32Array, waypoints: FloatArray) -> Float32Array:
    """(N + 1, 2) the way ahead that leads through the waypoints; the route where these hardly leave the ego.

    Args:
        route: (N + 1, 2) of `way_ahead`.
        waypoints: (4, 2) m, ego frame.

    Returns:
        The route, moved sideways: to the waypoints as far as they reach, and behind them by what their last piece leads
        away from the route until the ego has turned back.
    """
    last = int(np.linalg.norm(route - waypoints[-1], axis=1).argmin())
    if math.hypot(*waypoints[-1]) < SHORTEST_M or last == 0:
        return route
    along = _directions(route)
    points = np.vstack([np.zeros(2), waypoints])
    near = np.linalg.norm(route[:, None] - points[None], axis=2).argmin(axis=0)
    left = np.column_stack([-along[:, 1], along[:, 0]])
    aside = ((points - route[near]) * left[near]).sum(axis=1)
    metres = np.arange(len(route))
    slope = (aside[-1] - aside[-2]) / max(float(near[-1] - near[-2]), 1.0)
    beyond = np.clip(metres - last, 0.0, TURNS_M)
    offset = np.interp(metres, near, aside) + slope * (beyond - beyond**2 / (2 * TURNS_M))
    return np.asarray(route + offset[:, None] * left, dtype=np.float32)


def _directions(way: Float32Array) -> Float32Array:
    """(N, 2) unit vectors along a way."""
    along = np.diff(way, axis=0, append=2 * way[-1:] - way[-2:-1])
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-6)
    return along


def meeting(way: Float32Array, x: float, y: float, heading: float, length: float, width: float) -> Meeting | None:
    """Where the ego meets a box; None if it passes beside it, or its way ends before."""
    cos, sin = math.cos(heading), math.sin(heading)
    u, v = np.array([1, 1, -1, -1, 0]) * length / 2, np.array([1, -1, 1, -1, 0]) * width / 2
    corners = np.column_stack([x + u * cos - v * sin, y + u * sin + v * cos])
    apart = np.linalg.norm(way[:, None] - corners[None], axis=2)
    near = apart.argmin(axis=0)
    along = _directions(way)
    offset = corners - way[near]
    across = along[near, 0] * offset[:, 1] - along[near, 1] * offset[:, 0]
    forward = near + (along[near] * offset).sum(axis=1)
    reach = _VEHICLE.width / 2
    if across.min() > reach or across.max() < -reach or forward.max() < 0.0 or forward.min() >= len(way) - 1:
        return None
    first = along[near[forward.argmin()]]
    return Meeting(max(float(forward.min()) - _VEHICLE.length / 2, 0.0), math.atan2(first[1], first[0]))


def straight_ahead(path: Float32Array, metres: float, most: float) -> bool:
    """Whether the route's next metres turn by less than an angle [rad] from the ego's heading."""
    x, y = way_ahead(path)[math.ceil(metres)]
    return bool(abs(math.atan2(y, x)) < most)


def standing_gap(observation: Observation) -> float:
    """Free distance before the front bumper to what stands on the route, m; inf if nothing does within 30 m."""
    objects, route = observation["objects"], way_ahead(observation["path"])
    standing = objects[(objects[:, 0] >= 0) & (objects[:, 4] < STANDS_M_S) & (objects[:, 1] > 0.0)]
    boxes = ((*row[1:4], row[5], row[6] + 2 * MARGIN_STANDING_M) for row in standing.tolist())
    return min((met.gap for box in boxes if (met := meeting(route, *box)) is not None), default=math.inf)
