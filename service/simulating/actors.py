"""Actors that workers put into a world: by whom, and what has changed since the last tick."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from dohyo.service.errors import ConflictError
from dohyo.service.web.spelling import ACTOR_NAME
from dohyo.sumo_networks.actors.external import MOST_ACTORS, SIZES, ExternalActor, ExternalActors
from dohyo.sumo_networks.world import ActorKind

ActorName = Annotated[str, Meta(min_length=1, max_length=100, pattern=ACTOR_NAME)]
KindName = Literal["car", "van", "truck", "bus", "bicycle", "emergency", "pedestrian", "static"]
Role = Literal["ego", "traffic"]


class ActorRow(msgspec.Struct, omit_defaults=True, forbid_unknown_fields=True):
    """A box in the world, in the network's frame."""

    name: ActorName
    kind: KindName
    x_m: Annotated[float, Meta(description="x of the centre of the box, m.")]
    y_m: Annotated[float, Meta(description="y of the centre of the box, m.")]
    heading_rad: Annotated[float, Meta(description="Counter-clockwise from +x, rad.")] = 0.0
    speed_mps: Annotated[float, Meta(description="Speed along the heading, 0 to 100 m/s.")] = 0.0
    length_m: Annotated[float | None, Meta(description="Length, m; default: that of its kind.")] = None
    width_m: Annotated[float | None, Meta(description="Width, m; default: that of its kind.")] = None
    role: Annotated[Role | None, Meta(description="As shown rows have it, which may be sent back; without effect.")] = (
        None
    )

    def external(self) -> ExternalActor:
        """The actor for the simulation.

        Raises:
            InvalidInputError: A value is out of range.
        """
        kind = ActorKind[self.kind.upper()]
        length = SIZES[kind][0] if self.length_m is None else self.length_m
        width = SIZES[kind][1] if self.width_m is None else self.width_m
        return ExternalActor(self.name, kind, self.x_m, self.y_m, self.heading_rad, self.speed_mps, length, width)


class ShownActor(ActorRow, kw_only=True):
    """An ego or an actor of the traffic, as a world shows it to the simulators that are coupled to it."""

    role: Role


class ActorChange(msgspec.Struct, forbid_unknown_fields=True):
    """Actors that are put or moved before the next tick, after others are removed."""

    put: Annotated[list[ActorRow], Meta(max_length=MOST_ACTORS)] = []
    remove: Annotated[list[ActorName], Meta(max_length=MOST_ACTORS)] = []


class WorldActors:
    """The external actors of a live world. Who has put an actor moves and removes it."""

    def __init__(self) -> None:
        """Begins with none."""
        self.clear()

    def __len__(self) -> int:
        return len(self._external)

    def clear(self) -> None:
        """Forgets all actors: the world begins anew."""
        self._external = ExternalActors()
        self._by: dict[str, str] = {}
        self._put: dict[str, ActorRow] = {}  # since the last tick

    def change(self, by: str, change: ActorChange) -> None:
        """Removes actors, then puts and moves others, all or none.

        Args:
            by: Name of the worker; "" for the owner of the world.
            change: What changes.

        Raises:
            InvalidInputError: A value is out of range, there are too many, or an actor changes its kind or size.
            ConflictError: Another worker has put an actor of this name.
        """
        for name in [*(row.name for row in change.put), *change.remove]:
            if self._by.get(name, by) != by:
                raise ConflictError(f"actor '{name}' was put by {self._by[name] or 'the owner of the world'}")
        self._external.change([row.external() for row in change.put], change.remove)
        self._forget(change.remove)
        self._by |= {row.name: by for row in change.put}
        self._put |= {row.name: row for row in change.put}

    def forget(self, by: str) -> None:
        """Removes all that a worker has put."""
        names = [name for name, one in self._by.items() if one == by]
        self._external.remove(names)
        self._forget(names)

    def changed(self) -> ActorChange:
        """What has changed since the last call, for the next tick.

        The order is that of the workers' names, and of each one's rows: it decides the actors' keys in the record,
        so it does not depend on which worker is faster.
        """
        put = sorted(self._put.values(), key=lambda row: self._by[row.name])
        self._put = {}
        return ActorChange(put, self._external.begin_tick())

    def _forget(self, names: list[str]) -> None:
        for name in names:
            self._by.pop(name, None)
            self._put.pop(name, None)
