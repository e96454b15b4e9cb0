"""Right of way: the meaning of SUMO's letters for a driver, and the junctions ahead on a route."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum

from dohyo.sumo_networks.routes.route import Passage, Route


class RightOfWay(IntEnum):
    """Duty of a driver at a junction without a signal."""

    MAJOR = 0
    YIELD = 1
    STOP = 2


_OF_LETTER = {"m": RightOfWay.YIELD, "=": RightOfWay.YIELD, "s": RightOfWay.STOP, "w": RightOfWay.STOP}


def right_of_way(control: str) -> RightOfWay:
    """Right of way of a SUMO letter (m minor, = equal, s stop, w all-way stop; any other: major)."""
    return _OF_LETTER.get(control, RightOfWay.MAJOR)


def has_stop_sign(passage: Passage) -> bool:
    """Whether a stop sign, and no signal, guards a junction."""
    return right_of_way(passage.control) is RightOfWay.STOP and passage.signal < 0


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
