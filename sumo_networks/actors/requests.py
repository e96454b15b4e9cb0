"""Requests: what the population, the jaywalkers and the events want done in SUMO; the simulation applies them."""

from __future__ import annotations

from dataclasses import dataclass

from dohyo.sumo_networks.actors.scripted_actor import ScriptedActor
from dohyo.sumo_networks.world import ActorKind


@dataclass(frozen=True, slots=True)
class Walk:
    """A journey on foot between two edges with sidewalks.

    Attributes:
        source: SUMO edge id.
        source_m: Position on it, m.
        target: SUMO edge id.
        target_m: Position on it, m.
    """

    source: str
    source_m: float
    target: str
    target_m: float


@dataclass(frozen=True, slots=True)
class SpawnVehicle:
    """A vehicle or bicycle enters as soon as there is room, and SUMO drives it.

    Attributes:
        name: Of the vehicle and of its route.
        type: A vType of vehicle_types.add.xml.
        edges: SUMO edge ids, connected.
        lane: SUMO's departLane: an index on the first edge, or "best".
        position: SUMO's departPos: metres on that lane, "base" (its beginning) or "random_free".
        speed: SUMO's departSpeed: "max" or "desired".
        max_speed_mps: The vehicle drives no faster; None: as fast as its type and the limits allow.
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
    """A pedestrian sets out.

    Attributes:
        name: Unique in the episode.
        walk: From where to where.
        edges: SUMO edge ids of the way on foot.
    """

    name: str
    walk: Walk
    edges: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class CancelVehicle:
    """A vehicle that still waits for room is removed; one on the road stays."""

    name: str


@dataclass(frozen=True, slots=True)
class ClearArea:
    """Vehicles of the traffic whose front is near a point are removed; the population replaces them elsewhere.

    Attributes:
        x: m, network frame.
        y: m, network frame.
        radius_m: How near.
    """

    x: float
    y: float
    radius_m: float


@dataclass(frozen=True, slots=True)
class ShowActor:
    """The SUMO proxy of a scripted actor moves to the actor's box; off the roads it is hidden.

    Attributes:
        name: Of the actor.
        kind: What it is.
        x: m, network frame: centre of the box.
        y: m, network frame.
        heading: rad.
        length: m.
        width: m.
        across: Whether the actor moves across the road; its proxy is then turned along the lane.
        edges: Any route of the network, which SUMO wants for every vehicle.
    """

    name: str
    kind: ActorKind
    x: float
    y: float
    heading: float
    length: float
    width: float
    across: bool
    edges: tuple[str, ...]

    @classmethod
    def of(cls, actor: ScriptedActor, edges: tuple[str, ...]) -> ShowActor:
        """Request for an actor where it is now."""
        return cls(actor.name, actor.kind, *actor.box, actor.across, edges)


@dataclass(frozen=True, slots=True)
class HideActor:
    """The SUMO proxy of a scripted actor is removed."""

    name: str


Request = SpawnVehicle | SpawnPedestrian | CancelVehicle | ClearArea | ShowActor | HideActor
