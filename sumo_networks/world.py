"""World: the state after a tick, as arrays. Written by the simulation, read by criteria, sensors and rewards."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray, column
from dohyo.sumo_networks.objects import BoxColumns, ObjectStates, stack_boxes

if TYPE_CHECKING:
    from dohyo.sumo_networks.networks.network import RoadNetwork
    from dohyo.sumo_networks.routes.route import Route


class ActorKind(IntEnum):
    """Kind of an actor."""

    CAR = 0
    VAN = 1
    TRUCK = 2
    BUS = 3
    BICYCLE = 4
    EMERGENCY = 5
    PEDESTRIAN = 6
    STATIC = 7
    EGO = 8


class LightState(IntEnum):
    """State of one signal. SUMO's G and g are both GREEN, y and Y YELLOW, u (red-yellow) RED, o and O OFF.

    A green right-turn arrow (s) is OFF, too; `World.duties` says what it and a blinking light (o) ask for.
    """

    OFF = 0
    RED = 1
    YELLOW = 2
    GREEN = 3


@dataclass(frozen=True, slots=True)
class Egos:
    """States of the vehicles that agents drive, in the order of the scenario's missions.

    Attributes:
        names: Names of the E missions.
        active: (E,) False once the ego's episode has ended; its values in the other columns then stay the same.
        position: (E, 2), m, network frame: centre of the box.
        heading: (E,), rad, counter-clockwise from +x.
        speed: (E,), m/s, along the heading, never negative.
        acceleration: (E,), m/s^2, longitudinal.
        yaw_rate: (E,), rad/s.
        steering: (E,), rad, front wheel angle.
        length: (E,), m.
        width: (E,), m.
        progress: (E,), m, arc length of the box centre projected on the route (local window).
        lateral: (E,), m, signed distance to the route, left positive.
        route_heading_error: (E,), rad, heading minus the route's heading there, in [-pi, pi].
        lane: (E,) index of the nearest drivable lane, -1 if none within 30 m; among overlapping lanes (junctions) the
            route's own lane wins, then the one best aligned with the heading.
        lane_offset: (E,), m, signed distance to that lane's centreline, left positive; NaN if none.
        lane_heading_error: (E,), rad, heading minus that lane's direction, in [-pi, pi]; NaN if none.
        driven: (E,), m, distance driven so far.
        motion: (E, 10, 2), longitudinal acceleration [m/s^2] and yaw rate [rad/s] of the rear axle in each of the last
            ten substeps of 0.01 s, oldest first; zeros before the first tick.
    """

    names: tuple[str, ...]
    active: BoolArray
    position: FloatArray
    heading: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    yaw_rate: FloatArray
    steering: FloatArray
    length: FloatArray
    width: FloatArray
    progress: FloatArray
    lateral: FloatArray
    route_heading_error: FloatArray
    lane: IntArray
    lane_offset: FloatArray
    lane_heading_error: FloatArray
    driven: FloatArray
    motion: FloatArray = field(default_factory=lambda: np.zeros((0, 10, 2)))

    def boxes(self) -> FloatArray:
        """(E, 5) x, y [m], heading [rad], length, width [m]."""
        return stack_boxes(self.position, self.heading, self.length, self.width)

    def columns(self) -> BoxColumns:
        """Boxes and speeds of the egos, for numba kernels."""
        return self.position, self.heading, self.speed, self.length, self.width

    def box(self, ego: int) -> FloatArray:
        """(5,) x, y [m], heading [rad], length, width [m] of one ego."""
        return np.array([*self.position[ego], self.heading[ego], self.length[ego], self.width[ego]], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Actors(ObjectStates):
    """All M actors within sight of an ego, standing ones included and egos excluded; network frame.

    `World.name_of(key)` gives the SUMO id of a row.

    Attributes:
        lane: (M,) lane under the actor (a crossing or sidewalk for people), -1 if none.
        indicator: (M,) turn indicator: 1 left, -1 right, 0 off.
    """

    lane: IntArray = column(np.int64)
    indicator: IntArray = column(np.int64)


@dataclass(frozen=True, slots=True)
class Contact:
    """Two boxes that share a point after this tick, as seen by one ego.

    Attributes:
        ego: Index of the ego.
        key: The actor's key; for another ego, -1 - its index.
        kind: Kind of the other box (ActorKind.EGO for another ego).
        row: Row in `Actors`, or the other ego's index where kind is EGO.
    """

    ego: int
    key: int
    kind: ActorKind
    row: int


class EventPhase(StrEnum):
    """Phase of a scripted event."""

    WAITING = "waiting"
    ACTIVE = "active"
    DONE = "done"
    TIMED_OUT = "timed out"


@dataclass(frozen=True, slots=True)
class EventState:
    """State of one scripted event.

    Attributes:
        name: Name in the scenario.
        kind: Name of the event's kind in `dohyo.sumo_networks.events`.
        ego: Index of the ego around which it happens.
        phase: WAITING until the ego triggers the event, then ACTIVE until the event ends or times out.
        started: Simulated time at which the ego triggered it, s; NaN before.
        ended: Simulated time at which the event ended, s; NaN before.
        actors: Keys of the event's actors that have entered the world so far.
        ahead: Distance from the ego's centre forward to the centre of the event's first actor, along the route, m; NaN
            if unknown.
    """

    name: str
    kind: str
    ego: int
    phase: EventPhase
    started: float
    ended: float
    actors: tuple[int, ...]
    ahead: float


NO_DUTIES: IntArray = np.zeros(0, dtype=np.int64)
"""`World.duties` where no light can ask for a stop or for yielding."""


@dataclass(frozen=True, slots=True)
class World:
    """State of the simulation after a tick.

    Attributes:
        tick: Number of ticks since the egos started.
        time: Simulated seconds since the egos started.
        network: The road network; immutable.
        routes: One route per ego.
        egos: States of the vehicles that agents drive.
        actors: States of all other actors within sight.
        signals: (K,) LightState of each signal, indexed as `RoadNetwork.connections.signal`.
        contacts: Contacts between an ego and another box after this tick.
        names: SUMO ids by actor key.
        events: States of the scripted events, in the order of the scenario.
        duties: (K,) `rules.right_of_way.RightOfWay` that each signal asks for: STOP at a green right-turn arrow, YIELD
            at a blinking light, else MAJOR. Empty where no light of the network shows these, and in a replayed log.
    """

    tick: int
    time: float
    network: RoadNetwork
    routes: tuple[Route, ...]
    egos: Egos
    actors: Actors
    signals: IntArray
    contacts: tuple[Contact, ...]
    names: tuple[str, ...] | list[str]
    events: tuple[EventState, ...] = ()
    duties: IntArray = field(default_factory=lambda: NO_DUTIES)

    def name_of(self, key: int) -> str:
        """The SUMO id of an actor, or the mission name of an ego (negative keys)."""
        return self.names[key] if key >= 0 else self.egos.names[-1 - key]
