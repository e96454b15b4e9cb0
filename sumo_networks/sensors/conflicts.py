"""Conflicts: who will cross or join the ego's path, the meeting points, and the right of way.

The predictions are those of an attentive driver: others follow their lane and turn as indicated, and pedestrians keep
their direction for 6 s, at most 9 m. Egos have no indicators: another ego turns as its route does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from gymnasium.spaces import Box
from numba import njit

from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.command import Command
from dohyo.sumo_networks.routes.route import Passage
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.world import ActorKind, Actors, Egos, LightState, World

ROWS = 16
COLUMNS = 8
EGO_LOOKAHEAD_M = 60
NEAR_M = 100.0
ACTOR_LOOKAHEAD_M = 60.0
PEDESTRIAN_LOOKAHEAD_S = 6.0
PEDESTRIAN_LOOKAHEAD_M = 9.0
MARGIN_M = 0.4
_INDICATED = {1: "lLt", -1: "rR", 0: "s"}
_INDICATOR = {Command.LEFT: 1, Command.RIGHT: -1}


class _Other(NamedTuple):
    """An actor or another ego, in the units of `World`."""

    kind: int
    key: int
    x: float
    y: float
    heading: float
    speed: float
    length: float
    width: float
    lane: int
    indicator: int


class Conflicts(Sensor):
    """(16, 8) actors and other egos whose expected path meets the ego's route within 60 m, nearest conflict first.

    Columns: distance from the ego's front to the conflict area [m, negative beside the ego], distance that the ego's
    front must drive until its rear has left the area [m] (1000 if the other joins the ego's lane), distance from the
    other's front to the area [m] (negative: inside), distance that the other's front must drive until its rear has left
    [m], the other's speed [m/s], right of way (1 the ego must give way, 0 undecided, -1 the other must), kind
    (`world.ActorKind`), key (-1 - its index for an ego). Leaders and followers on the ego's path are no conflicts and
    are left out. Unused rows have distances of 1000 and kind -1.
    """

    name = "conflicts"
    track = Track.PRIVILEGED
    space = Box(-np.inf, np.inf, (ROWS, COLUMNS), np.float32)

    def __init__(self) -> None:
        self._paths: dict[tuple[int, int], tuple[FloatArray, int, float]] = {}
        self._network: RoadNetwork | None = None

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        if self._network is not world.network:
            self._network, self._paths = world.network, {}
        route, egos = world.routes[ego], world.egos
        # The path starts under the rear bumper: a pedestrian who walks into the ego's side is a conflict too.
        length, half_width = float(egos.length[ego]), float(egos.width[ego]) / 2
        rear = float(egos.progress[ego]) - length / 2
        first, spacing = route.index(rear), route.length / (len(route.position) - 1)
        # Place of the ego's rear on that path: not its start if the route has only begun.
        rear -= first * spacing
        path = route.position[first : first + EGO_LOOKAHEAD_M]
        rows = []
        for other in _others_near(world, ego):
            expected, connection, to_junction = self._expected_path(world.network, other)
            if len(expected) < 2:
                continue
            half_length, reach = other.length / 2, half_width + other.width / 2 + MARGIN_M
            enter, leave, other_enter, other_leave = _meeting(path, expected, reach)
            if enter < 0:
                continue
            priority = _priority(world, ego, (first + enter) * spacing, other, connection, to_junction)
            rows.append(
                (
                    enter * spacing - rear - length,
                    leave * spacing - rear if leave < len(path) - 1 else 1000.0,
                    other_enter - half_length,
                    other_leave + half_length,
                    other.speed,
                    priority,
                    float(other.kind),
                    float(other.key),
                )
            )
        rows.sort()
        out = np.zeros((ROWS, COLUMNS), dtype=np.float32)
        out[:, :4], out[:, 6] = 1000.0, -1.0
        if rows:
            out[: min(len(rows), ROWS)] = rows[:ROWS]
        return out

    def _expected_path(self, network: RoadNetwork, other: _Other) -> tuple[FloatArray, int, float]:
        """Points 1 m apart from the other's centre on, its next connection, and the distance to that junction [m]."""
        x, y = other.x, other.y
        if other.kind == ActorKind.PEDESTRIAN:
            reach = min(other.speed * PEDESTRIAN_LOOKAHEAD_S, PEDESTRIAN_LOOKAHEAD_M) if other.speed > 0.1 else 0.0
            steps = np.arange(0.0, reach, 0.5)
            ahead = x + steps * math.cos(other.heading), y + steps * math.sin(other.heading)
            return np.column_stack(ahead), -1, 1000.0
        if other.lane < 0 or network.lanes.crossing[other.lane]:
            return np.empty((0, 2)), -1, 1000.0
        key = (other.lane, other.indicator)
        if key not in self._paths:
            self._paths[key] = _lane_path(network, *key)
        points, connection, junction = self._paths[key]
        offset = points[:, 0] - x, points[:, 1] - y
        nearest = int(np.argmin(np.hypot(*offset)[: int(network.lanes.length[other.lane]) + 2]))
        return points[nearest:], connection, junction - nearest - other.length / 2


def _others_near(world: World, ego: int) -> Iterator[_Other]:
    """Actors, then other active egos, within 100 m of an ego."""
    actors, egos, here = world.actors, world.egos, world.egos.position[ego]
    for i in np.flatnonzero(np.hypot(*(actors.position - here).T) < NEAR_M).tolist():
        known = actors.kind.item(i), actors.key.item(i), actors.lane.item(i), actors.indicator.item(i)
        yield _other(actors, i, *known)
    if len(egos.names) == 1:
        return
    for i in np.flatnonzero(egos.active & (np.hypot(*(egos.position - here).T) < NEAR_M)).tolist():
        if i != ego:
            yield _other(egos, i, int(ActorKind.EGO), -1 - i, _lane_under(world, i), _turn(world, i))


def _other(table: Actors | Egos, row: int, kind: int, key: int, lane: int, indicator: int) -> _Other:
    x, y = table.position[row].tolist()
    body = table.heading.item(row), table.speed.item(row), table.length.item(row), table.width.item(row)
    return _Other(kind, key, x, y, *body, lane, indicator)


def _lane_under(world: World, ego: int) -> int:
    """The lane in which an ego drives; -1 beside all lanes, or against the lane's direction."""
    egos, lane = world.egos, world.egos.lane.item(ego)
    inside = lane >= 0 and abs(egos.lane_offset.item(ego)) <= 0.5 * world.network.lanes.width.item(lane)
    return lane if inside and abs(egos.lane_heading_error.item(ego)) < math.pi / 2 else -1


def _turn(world: World, ego: int) -> int:
    """The turn of an ego's route at its next junction: 1 left, -1 right, 0 none."""
    progress = world.egos.progress[ego]
    ahead = (passage.command for passage in world.routes[ego].passages if passage.entry >= progress)
    return _INDICATOR.get(next(ahead, Command.STRAIGHT), 0)


def _priority(world: World, ego: int, meets_at: float, other: _Other, connection: int, to_junction: float) -> float:
    """Right of way: 1 the ego must give way, -1 the other must, 0 undecided."""
    network = world.network
    if other.kind == ActorKind.PEDESTRIAN:
        return 1.0
    passage = _passage_at(world.routes[ego].passages, meets_at)
    if passage is None:
        return 1.0
    if network.lanes.internal[other.lane] or to_junction < 0.0:
        return 1.0 if world.egos.progress[ego] < passage.entry else 0.0
    if connection < 0:
        return 0.0
    signal = int(network.connections.signal[connection])
    if signal >= 0 and world.signals[signal] == LightState.RED:
        return -1.0
    yields = (passage.connection, connection) in network.gives_way_to
    if not yields and (connection, passage.connection) not in network.gives_way_to:
        return 0.0
    if len(world.duties) and signal >= 0 and passage.signal >= 0:
        mine, others = world.duties[[passage.signal, signal]].tolist()
        yields = mine > others if mine != others else yields
    return 1.0 if yields else -1.0


def _passage_at(passages: tuple[Passage, ...], s: float) -> Passage | None:
    """Junction passage at an arc length, or the last one before it."""
    found = None
    for passage in passages:
        if passage.entry - 2.0 <= s:
            found = passage
    return found


def _lane_path(network: RoadNetwork, lane: int, indicator: int) -> tuple[FloatArray, int, float]:
    """Expected path of an actor on a lane: points 1 m apart, its first connection, and the distance to that [m]."""
    connections, here = network.connections, lane
    shapes, length = [network.lane_shape(lane)], float(network.lanes.length[lane])
    enough, connection, to_junction = length + ACTOR_LOOKAHEAD_M, -1, 1000.0
    while length < enough and (onward := network.connections_from(here)):
        wanted = (_INDICATED[indicator] if connection < 0 else "s") + "i"
        chosen = next((c for c in onward if str(connections.direction[c]) in wanted), onward[0])
        if connection < 0 and connections.direction[chosen] != "i":
            connection, to_junction = chosen, length
        here = int(connections.target[chosen])
        shapes.append(network.lane_shape(here))
        length += float(network.lanes.length[here])
    raw = np.concatenate(shapes)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(raw, axis=0).T))])
    at = np.arange(0.0, arc[-1], 1.0)
    return np.column_stack([np.interp(at, arc, raw[:, i]) for i in (0, 1)]), connection, to_junction


@njit(cache=True)
def _meeting(ego: FloatArray, other: FloatArray, reach: float) -> tuple[int, int, float, float]:
    """Finds where two paths come within reach [m] of each other.

    Returns:
        Indices on the ego's path at which the paths meet and part, then distances along the other's path [m]. The first
        is -1 if the paths never meet, or if the other is in the ego's path already, or behind it, with the same
        direction.
    """
    enter, leave, other_enter, other_leave = -1, -1, 1_000_000, -1
    spacing = math.hypot(other[1, 0] - other[0, 0], other[1, 1] - other[0, 1])
    for i in range(ego.shape[0]):
        for j in range(other.shape[0]):
            dx, dy = ego[i, 0] - other[j, 0], ego[i, 1] - other[j, 1]
            if dx * dx + dy * dy < reach * reach:
                if enter < 0:
                    enter = i
                leave = i
                other_enter = min(other_enter, j)
                other_leave = max(other_leave, j)
    if enter < 0:
        return -1, 0, 0.0, 0.0
    if (other_enter == 0 or enter == 0) and ego.shape[0] > enter + 1:
        ex, ey = ego[enter + 1, 0] - ego[enter, 0], ego[enter + 1, 1] - ego[enter, 1]
        j = min(other_enter, other.shape[0] - 2)
        ox, oy = other[j + 1, 0] - other[j, 0], other[j + 1, 1] - other[j, 1]
        if ex * ox + ey * oy > 0.7 * math.hypot(ex, ey) * math.hypot(ox, oy):
            return -1, 0, 0.0, 0.0
    return enter, leave, other_enter * spacing, other_leave * spacing
