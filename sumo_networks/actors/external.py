"""ExternalActors: actors that another simulator puts, moves and removes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from dohyo.sumo_networks.actors.names import external_actor
from dohyo.sumo_networks.actors.requests import HideActor, Request, ShowActor
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.world import ActorKind

MOST_ACTORS: Final = 2000
MOST_NAMES: Final = 50_000
"""Names of external actors that one simulation may show; each stays in its registry, and in memory."""
FASTEST_MPS: Final = 100.0
LONGEST_M: Final = 50.0
FARTHEST_M: Final = 1e7
SIZES: Final = MappingProxyType(
    {
        ActorKind.CAR: (4.6, 1.8),
        ActorKind.VAN: (6.2, 2.1),
        ActorKind.TRUCK: (9.5, 2.45),
        ActorKind.BUS: (12.0, 2.5),
        ActorKind.BICYCLE: (1.6, 0.65),
        ActorKind.EMERGENCY: (6.5, 2.2),
        ActorKind.PEDESTRIAN: (0.5, 0.5),
        ActorKind.STATIC: (1.0, 1.0),
    }
)
"""Length and width of an actor whose size is not given, m."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.:-]{0,99}")
_Body = tuple[ActorKind, float, float]


@dataclass(frozen=True, slots=True)
class ExternalActor:
    """A box that another simulator moves.

    Attributes:
        name: Unique among the external actors.
        kind: Kind of the actor, not EGO.
        x: x of the box centre, m, network frame.
        y: y of the box centre, m, network frame.
        heading: rad, counter-clockwise from +x.
        speed: Speed along the heading, m/s; not negative.
        length: Length of the box, m.
        width: Width of the box, m.
    """

    name: str
    kind: ActorKind
    x: float
    y: float
    heading: float
    speed: float
    length: float
    width: float

    def __post_init__(self) -> None:
        """Checks all values.

        Raises:
            InvalidInputError: A value is out of range or not finite.
        """
        where = f"actor '{self.name[:100]}'"
        if not _NAME.fullmatch(self.name):
            raise InvalidInputError(f"{where}: expected a name of letters, digits and _.:-, at most 100")
        if self.kind not in SIZES:
            raise InvalidInputError(f"{where}: expected a kind other than {self.kind.name.lower()}")
        if not all(math.isfinite(one) and abs(one) <= FARTHEST_M for one in (self.x, self.y, self.heading)):
            raise InvalidInputError(f"{where}: expected a finite place, got {self.x}, {self.y}, {self.heading}")
        if not 0.0 <= self.speed <= FASTEST_MPS:
            raise InvalidInputError(f"{where}: expected a speed of 0 to {FASTEST_MPS:g} m/s, got {self.speed}")
        if not all(0.05 <= one <= LONGEST_M for one in (self.length, self.width)):
            raise InvalidInputError(
                f"{where}: expected a size of 0.05 to {LONGEST_M:g} m, got {self.length}, {self.width}"
            )

    @property
    def body(self) -> _Body:
        """Kind, length and width [m]."""
        return self.kind, self.length, self.width


class ExternalActors:
    """All external actors of one simulation.

    They stay where they were put until they are put elsewhere. A name that a tick has shown keeps its kind and its
    size, also after it was removed.
    """

    def __init__(self) -> None:
        """Begins with none."""
        self._actors: dict[str, ExternalActor] = {}
        self._bodies: dict[str, _Body] = {}  # of all names that a tick has shown
        self._last: tuple[str, ...] = ()  # names in the last tick

    def __len__(self) -> int:
        return len(self._actors)

    def __iter__(self) -> Iterator[ExternalActor]:
        return iter(self._actors.values())

    def put(self, actors: Iterable[ExternalActor]) -> None:
        """Puts new actors and moves those that are there; see `change`."""
        self.change(actors, ())

    def remove(self, names: Iterable[str]) -> None:
        """Removes actors; a name that is not there is no error."""
        self.change((), names)

    def change(self, put: Iterable[ExternalActor], remove: Iterable[str]) -> None:
        """Removes actors, then puts new ones and moves those that are there; either all or none.

        Raises:
            InvalidInputError: There would be too many actors or names, or an actor changes its kind or size.
        """
        gone, given = set(remove), {actor.name: actor for actor in put}
        kept = {name: one for name, one in self._actors.items() if name not in gone}
        for name, one in given.items():
            kind, length, width = self._bodies.get(name) or kept.get(name, one).body
            if one.body != (kind, length, width):
                first = f"{kind.name.lower()} of {length:g} by {width:g} m"
                raise InvalidInputError(f"actor '{name}': expected its first kind and size, {first}")
        after = kept | given
        if len(after) > MOST_ACTORS:
            raise InvalidInputError(f"actors: expected at most {MOST_ACTORS} external actors, got more")
        if len(self._bodies) + sum(name not in self._bodies for name in after) > MOST_NAMES:
            raise InvalidInputError(f"actors: expected at most {MOST_NAMES} names, got more; use removed ones again")
        self._actors = after

    def begin_tick(self) -> list[str]:
        """Shows all actors in the next tick; returns the names that only the tick before it had."""
        gone = [name for name in self._last if name not in self._actors]
        self._bodies |= {name: one.body for name, one in self._actors.items() if name not in self._bodies}
        self._last = tuple(self._actors)
        return gone

    def requests(self, edges: tuple[str, ...]) -> Iterator[Request]:
        """Requests that move their SUMO proxies; this begins a tick.

        Args:
            edges: Any route of the network, since SUMO requires one for every proxy.
        """
        for name in self.begin_tick():
            yield HideActor(external_actor(name))
        for one in self._actors.values():
            box = one.x, one.y, one.heading, one.length, one.width
            yield ShowActor(external_actor(one.name), one.kind, *box, across=None, edges=edges)
