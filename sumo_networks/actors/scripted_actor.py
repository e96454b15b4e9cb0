"""ScriptedActor: an actor that a script moves. The world lists it like any other; SUMO has a proxy of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from dohyo.sumo_networks.actors.paths import ActorPath
from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.world import ActorKind

ACCELERATION_MPS2 = 2.5
COMFORTABLE_MPS2 = 4.0
HARDEST_MPS2 = 8.0
STANDSTILL_GAP_M = 2.0
REACH_M = 60.0
BESIDE_M = 0.2

VEHICLES = {
    "car": (ActorKind.CAR, 4.6, 1.8),
    "van": (ActorKind.VAN, 6.2, 2.1),
    "truck": (ActorKind.TRUCK, 9.5, 2.45),
    "bus": (ActorKind.BUS, 12.0, 2.5),
    "emergency": (ActorKind.EMERGENCY, 6.5, 2.2),
}
"""Kind, length and width [m] by type, as in vehicle_types.add.xml."""


@dataclass(slots=True)
class ScriptedActor:
    """A box that a script moves along a path.

    Attributes:
        name: Unique in the episode.
        kind: Kind of the actor.
        length: Length of the box, m.
        width: Width of the box, m.
        path: Path along which the actor moves.
        s: Arc length of the box centre, m.
        left: Distance of the box centre to the left of the path, m.
        speed: Speed along the path, m/s.
        drift: Speed to the left, m/s.
        skew: Heading minus the path's heading, for objects that stand at an angle, rad.
        across: Whether the actor moves across the road; its SUMO proxy is then turned along the lane.
        indicator: Turn indicator: 1 left, -1 right; 0: set by the drift.
        present: Whether the actor is in the world.
    """

    name: str
    kind: ActorKind
    length: float
    width: float
    path: ActorPath
    s: float
    left: float = 0.0
    speed: float = 0.0
    drift: float = 0.0
    skew: float = 0.0
    across: bool = False
    indicator: int = 0
    present: bool = False
    x: float = field(default=math.nan, init=False)
    y: float = field(default=math.nan, init=False)
    heading: float = field(default=math.nan, init=False)

    def __post_init__(self) -> None:
        self.pose()

    def move(self, seconds: float) -> None:
        """Moves along the path for a time [s]."""
        self.s += self.speed * seconds
        self.left += self.drift * seconds
        self.pose()

    def pose(self) -> None:
        """Computes x, y [m] and heading [rad] from the place on the path."""
        self.x, self.y, direction = self.path.at(self.s, self.left)
        turn = math.atan2(self.drift, max(self.speed, 1.0)) if self.drift else 0.0
        self.heading = direction + turn + self.skew

    @property
    def box(self) -> tuple[float, float, float, float, float]:
        """x, y [m], heading [rad], length, width [m]."""
        return self.x, self.y, self.heading, self.length, self.width

    def distance(self, x: float, y: float) -> float:
        """Distance of the box centre to a point, m."""
        return math.hypot(self.x - x, self.y - y)

    def approach(self, desired: float, seconds: float, gap: float = math.inf, leader: float = 0.0) -> None:
        """Changes the speed towards a desired speed, such that the actor can stop behind a leader.

        Args:
            desired: Desired speed, m/s.
            seconds: Length of the time step, s.
            gap: Gap to the leader's rear, m.
            leader: Speed of the leader, m/s.
        """
        safe = math.inf
        if gap < math.inf:
            safe = math.sqrt(leader**2 + 2 * COMFORTABLE_MPS2 * max(gap - STANDSTILL_GAP_M, 0.0))
        lowest = max(self.speed - HARDEST_MPS2 * seconds, 0.0)
        self.speed = max(min(desired, safe, self.speed + ACCELERATION_MPS2 * seconds), lowest)

    def leader(self, boxes: FloatArray, speeds: FloatArray) -> tuple[float, float]:
        """Gap and speed of the nearest box in the actor's way.

        Args:
            boxes: (M, 5) x, y [m], heading [rad], length, width [m].
            speeds: (M,) speeds of the boxes, m/s.

        Returns:
            Gap between the bumpers [m] and the box's speed along the path [m/s]; infinity and 0 if the path is free.
        """
        near = np.hypot(boxes[:, 0] - self.x, boxes[:, 1] - self.y) < REACH_M
        if not near.any():
            return math.inf, 0.0
        boxes, speeds = boxes[near], speeds[near]
        s, left = self.path.project(boxes[:, :2], self.s - 5.0, self.s + REACH_M)
        direction = boxes[:, 2] - np.array([self.path.at(float(one))[2] for one in s])
        cos, sin = np.abs(np.cos(direction)), np.abs(np.sin(direction))
        along, across = boxes[:, 3] * cos + boxes[:, 4] * sin, boxes[:, 3] * sin + boxes[:, 4] * cos
        ahead: BoolArray = (s > self.s) & (np.abs(left - self.left) < 0.5 * (across + self.width) + BESIDE_M)
        if not ahead.any():
            return math.inf, 0.0
        gap = s - self.s - 0.5 * (along + self.length)
        first = int(np.argmin(np.where(ahead, gap, math.inf)))
        return max(float(gap[first]), 0.0), max(float(speeds[first] * np.cos(direction[first])), 0.0)
