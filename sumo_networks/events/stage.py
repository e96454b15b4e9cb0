"""Stage: what events ask of the simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from dohyo.sumo_networks.events.puppet import Puppet


@dataclass(frozen=True, slots=True)
class Entry:
    """A vehicle that enters the road and is driven by SUMO.

    Attributes:
        type: A vType of vehicle_types.add.xml.
        edges: SUMO edge ids, connected.
        lane: Index of the lane on the first edge.
        position_m: Of its front on that lane.
        max_speed_mps: It drives no faster; None: as fast as its type and the limits allow.
    """

    type: str
    edges: tuple[str, ...]
    lane: int
    position_m: float
    max_speed_mps: float | None = None


class Stage(Protocol):
    """What events ask of the simulation."""

    def show(self, puppet: Puppet, edges: tuple[str, ...]) -> None:
        """Moves a puppet's image on the roads, so that the traffic gives way to it; off the roads it has none.

        Args:
            puppet: What is shown.
            edges: Any route in the network, which an image must have.
        """

    def hide(self, puppet: Puppet) -> None:
        """Takes a puppet's image away."""

    def clear(self, x: float, y: float, radius_m: float) -> None:
        """Takes vehicles of the traffic away that are nearer than this; others come for them elsewhere."""

    def enter(self, name: str, entry: Entry) -> None:
        """Lets a vehicle enter as soon as there is room."""

    def entered(self, name: str) -> bool:
        """Whether a vehicle is on the road, or has been."""

    def withdraw(self, name: str) -> None:
        """Takes a vehicle away if it is still waiting for room."""
