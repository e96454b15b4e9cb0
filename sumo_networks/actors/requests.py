"""Requests of the population, the jaywalkers and the events to SUMO; the simulation applies them."""

from __future__ import annotations

from dataclasses import dataclass

from dohyo.sumo_networks.actors.scripted_actor import ScriptedActor
from dohyo.sumo_networks.world import ActorKind


@dataclass(frozen=True, slots=True)
class Walk:
    """A journey on foot between two edges with sidewalks.

    Attributes:
        source: SUMO edge id.
        source_m: Position on the source, m.
        target: SUMO edge id.
        target_m: Position on the target, m.
    """

    source: str
    source_m: float
    target: str
    target_m: float


@dataclass(frozen=True, slots=True)
class SpawnVehicle:
    """Lets a vehicle or bicycle enter as soon as there is room; SUMO drives it.

    Attributes:
        name: Name of the vehicle and of its route.
        type: Name of a vType in vehicle_types.add.xml.
        edges: Connected SUMO edge ids.
        lane: SUMO's departLane: an index on the first edge, or "best".
        position: SUMO's departPos: metres on that lane, "base" (its beginning) or "random_free".
        speed: SUMO's departSpeed: "max" or "desired".
        max_speed_mps: Highest speed, m/s; None: as fast as its type and the limits allow.
    """

    name: str
    type: str
    edges: tuple[str, ...]
    lane: str = "best"
    position: str = "base"
    speed: str = "max"
    max_speed_mps: float | None = None


@dataclass(frozen=True, slots=True)
class SpawnPedestrian:
    """Lets a pedestrian enter.

    Attributes:
        name: Unique in the episode.
        walk: Start and end of the journey.
        edges: SUMO edge ids of the path on foot.
    """

    name: str
    walk: Walk
    edges: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class CancelVehicle:
    """Removes a vehicle that still waits for room; a vehicle on the road stays."""

    name: str


@dataclass(frozen=True, slots=True)
class ClearArea:
    """Removes the traffic's vehicles whose front is near a point; the population replaces them elsewhere.

    Attributes:
        x: x of the point, m, network frame.
        y: y of the point, m, network frame.
        radius_m: Largest distance of a removed front, m.
    """

    x: float
    y: float
    radius_m: float


@dataclass(frozen=True, slots=True)
class ShowActor:
    """Moves the SUMO proxy of a scripted actor to the actor's box; off the roads the proxy is hidden.

    Attributes:
        name: Name of the actor.
        kind: Kind of the actor.
        x: x of the box centre, m, network frame.
        y: y of the box centre, m, network frame.
        heading: Heading of the box, rad.
        length: Length of the box, m.
        width: Width of the box, m.
        across: Whether the actor moves across the road; its proxy is then turned along the lane. None: as its heading
            says.
        edges: Any route of the network, since SUMO requires one for every vehicle.
        askew: Whether the actor stands at an angle to the road; its proxy stands along it, with the same extent.
    """

    name: str
    kind: ActorKind
    x: float
    y: float
    heading: float
    length: float
    width: float
    across: bool | None
    edges: tuple[str, ...]
    askew: bool = False

    @classmethod
    def of(cls, actor: ScriptedActor, edges: tuple[str, ...]) -> ShowActor:
        """Request for an actor at its current place."""
        return cls(actor.name, actor.kind, *actor.box, actor.across, edges, askew=actor.skew != 0.0)


@dataclass(frozen=True, slots=True)
class HideActor:
    """Removes the SUMO proxy of a scripted actor."""

    name: str


Request = SpawnVehicle | SpawnPedestrian | CancelVehicle | ClearArea | ShowActor | HideActor
