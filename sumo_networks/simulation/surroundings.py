"""Surroundings: what SUMO tells of the actors near the egos, by the way that costs least."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

import libsumo

from sumo_networks.scenario import Traffic
from sumo_networks.world import SIGHT_M

Reading = tuple[str, float, float, float, float, str, int]
"""Name, x, y [m, SUMO's point of reference], angle [degrees clockwise from north], speed [m/s], lane id, signals."""

FEW: Final = 80
SPARE_M: Final = 20.0
_NO_SIGNALS: Final = 0
_PERSON_VARIABLES = (libsumo.VAR_POSITION, libsumo.VAR_ANGLE, libsumo.VAR_SPEED, libsumo.VAR_LANE_ID)
_VEHICLE_VARIABLES = (*_PERSON_VARIABLES, libsumo.VAR_SIGNALS)
_Point = tuple[float, float]


class Surroundings:
    """Reads the vehicles and people within sight of the egos.

    Few are asked one by one. Of many, SUMO collects those around each ego by itself: a context subscription slows its
    step by 150 us in a junction full of vehicles, whereas asking costs 2 us each (make bench, ingolstadt with 50).
    """

    def __init__(self, traffic: Traffic, egos: int) -> None:
        few = FEW * egos  # SUMO collects once per ego, we ask once for all
        self._few = (traffic.vehicles + traffic.bicycles <= few, traffic.pedestrians <= few)
        self._viewpoints: dict[str, _Point] = {}

    def add(self, viewpoint: str) -> None:
        """Begins to look around a point, which `move` brings to its place."""
        self._viewpoints[viewpoint] = (0.0, 0.0)
        # A context around a point of interest outlives whatever SUMO does to an ego's image.
        libsumo.poi.add(viewpoint, 0.0, 0.0, (0, 0, 0, 0))
        for domain, variables in self._subscriptions():
            libsumo.poi.subscribeContext(viewpoint, domain, SIGHT_M + SPARE_M, variables)

    def move(self, viewpoint: str, x: float, y: float) -> None:
        """Looks around another point, from the next step on."""
        self._viewpoints[viewpoint] = (x, y)
        libsumo.poi.setPosition(viewpoint, x, y)

    def forget(self, viewpoint: str) -> None:
        """Looks there no more."""
        # SUMO fails at its next step if a subscribed object is removed.
        for domain, _ in self._subscriptions():
            libsumo.poi.unsubscribeContext(viewpoint, domain, SIGHT_M + SPARE_M)
        libsumo.poi.remove(viewpoint)
        del self._viewpoints[viewpoint]

    def read(self) -> Iterator[Reading]:
        """Everyone in sight; one who is near several egos may come several times."""
        points = list(self._viewpoints.values())
        few_vehicles, few_people = self._few
        if few_vehicles:
            yield from _asked(libsumo.vehicle, points, libsumo.vehicle.getSignals)
        if few_people:
            yield from _asked(libsumo.person, points, lambda _: _NO_SIGNALS)
        if not (few_vehicles and few_people):
            yield from self._told(points)

    def _told(self, points: Sequence[_Point]) -> Iterator[Reading]:
        # SUMO measures a context's range in ways of its own, so it is asked for more, and both ways tell the same.
        for viewpoint in self._viewpoints:
            for name, values in libsumo.poi.getContextSubscriptionResults(viewpoint).items():
                x, y = values[libsumo.VAR_POSITION]
                if _in_sight(x, y, points):
                    angle, speed, lane = (values[variable] for variable in _PERSON_VARIABLES[1:])
                    yield name, x, y, angle, speed, lane, values.get(libsumo.VAR_SIGNALS, _NO_SIGNALS)

    def _subscriptions(self) -> Iterator[tuple[int, Sequence[int]]]:
        few_vehicles, few_people = self._few
        if not few_vehicles:
            yield libsumo.CMD_GET_VEHICLE_VARIABLE, _VEHICLE_VARIABLES
        if not few_people:
            yield libsumo.CMD_GET_PERSON_VARIABLE, _PERSON_VARIABLES


def _asked(domain: Any, points: Sequence[_Point], signals: Callable[[str], int]) -> Iterator[Reading]:
    position, angle, speed, lane = domain.getPosition, domain.getAngle, domain.getSpeed, domain.getLaneID
    for name in domain.getIDList():
        x, y = position(name)
        if _in_sight(x, y, points):
            yield name, x, y, angle(name), speed(name), lane(name), signals(name)


def _in_sight(x: float, y: float, points: Sequence[_Point]) -> bool:
    for px, py in points:  # noqa: SIM110 - any() would take twice as long
        if (x - px) * (x - px) + (y - py) * (y - py) <= SIGHT_M * SIGHT_M:
            return True
    return False
