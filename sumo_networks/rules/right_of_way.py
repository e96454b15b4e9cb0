"""Right of way: what SUMO's letters and lights ask of a driver, and the junctions ahead on a route."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum

from dohyo.sumo_networks.routes.route import Passage, Route
from dohyo.sumo_networks.world import World


class RightOfWay(IntEnum):
    """Duty of a driver at a junction; red and yellow lights come on top of it."""

    MAJOR = 0
    YIELD = 1
    STOP = 2


_OF_LETTER = {"m": RightOfWay.YIELD, "=": RightOfWay.YIELD, "s": RightOfWay.STOP, "w": RightOfWay.STOP}


def right_of_way(control: str) -> RightOfWay:
    """Right of way of a SUMO letter (m minor, = equal, s stop, w all-way stop; any other: major)."""
    return _OF_LETTER.get(control, RightOfWay.MAJOR)


def duty(world: World, passage: Passage) -> RightOfWay:
    """What a junction asks of a driver in this tick: by its signal if there is one, else by the road's letter.

    A green right-turn arrow asks to stop and a blinking light to yield. Where a light works, the road's letter, which
    says what holds while it is off, does not count.
    """
    if passage.signal < 0:
        return right_of_way(passage.control)
    return RightOfWay(world.duties.item(passage.signal)) if len(world.duties) else RightOfWay.MAJOR


def passages_within(route: Route, s: float, within_m: float) -> Iterator[tuple[float, Passage]]:
    """Junctions that begin on the next metres of a route, nearest first.

    Args:
        route: The route.
        s: Arc length at which the search starts, m.
        within_m: Length of the search, m.

    Yields:
        Distance to the junction's entry, m, and the passage.
    """
    for passage in route.passages:
        ahead = passage.entry - s
        if 0.0 <= ahead < within_m:
            yield ahead, passage
