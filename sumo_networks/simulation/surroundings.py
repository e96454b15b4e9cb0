"""Surroundings: the actors near the egos, read from SUMO in the fastest way."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

import libsumo

from dohyo.sumo_networks.scenario import Traffic
from dohyo.sumo_networks.units import SIGHT_M, TICK_S

Reading = tuple[str, float, float, float, float, str, int]
"""Name, x, y [m, SUMO's point of reference], angle [degrees clockwise from north], speed [m/s], lane id, signals."""

FEW: Final = 80
SPARE_M: Final = 20.0
FASTEST_MPS: Final = 60.0  # highest speed of SUMO's vehicles and of the egos
_ELSEWHERE_M: Final = 1e8  # beyond: SUMO's position of a vehicle that it is teleporting
_NO_SIGNALS: Final = 0
_PERSON_VARIABLES = (libsumo.VAR_POSITION, libsumo.VAR_ANGLE, libsumo.VAR_SPEED, libsumo.VAR_LANE_ID)
_VEHICLE_VARIABLES = (*_PERSON_VARIABLES, libsumo.VAR_SIGNALS)
_Point = tuple[float, float]


class Surroundings:
    """Reads the vehicles and people within sight of the egos.

    A small population is read actor by actor, at 2 us each. For a large one, SUMO collects the actors around each ego
    by a context subscription, which slows its step by 150 us in a full junction (make bench, ingolstadt with 50).
    An actor far away is not read again before it could come into sight, at twice the highest speed.
    """

    def __init__(self, traffic: Traffic, egos: int) -> None:
        few = FEW * egos  # a subscription per ego, against one reading of all actors
        self._few = (traffic.vehicles + traffic.bicycles <= few, traffic.pedestrians <= few)
        self._viewpoints: dict[str, _Point] = {}
        self._reads = 0
        self._not_before: dict[str, int] = {}

    def add(self, viewpoint: str) -> None:
        """Adds a viewpoint; `move` sets its place."""
        self._viewpoints[viewpoint] = (0.0, 0.0)
        # A subscription around a point of interest stays valid when SUMO removes or teleports an ego's proxy.
        libsumo.poi.add(viewpoint, 0.0, 0.0, (0, 0, 0, 0))
        for domain, variables in self._subscriptions():
            libsumo.poi.subscribeContext(viewpoint, domain, SIGHT_M + SPARE_M, variables)

    def move(self, viewpoint: str, x: float, y: float) -> None:
        """Moves a viewpoint, from the next step on."""
        self._viewpoints[viewpoint] = (x, y)
        if not all(self._few):
            libsumo.poi.setPosition(viewpoint, x, y)

    def forget(self, viewpoint: str) -> None:
        """Removes a viewpoint."""
        # SUMO fails at its next step if a subscribed object is removed.
        for domain, _ in self._subscriptions():
            libsumo.poi.unsubscribeContext(viewpoint, domain, SIGHT_M + SPARE_M)
        libsumo.poi.remove(viewpoint)
        del self._viewpoints[viewpoint]

    def read(self) -> list[Reading]:
        """Reads all actors in sight; an actor near several egos may be listed several times."""
        points = list(self._viewpoints.values())
        few_vehicles, few_people = self._few
        self._reads += 1
        if libsumo.simulation.getEndingTeleportNumber():
            self._not_before.clear()  # SUMO has teleported vehicles
        found: list[Reading] = []
        if few_vehicles:
            self._ask(libsumo.vehicle, points, libsumo.vehicle.getSignals, found)
        if few_people:
            self._ask(libsumo.person, points, lambda _: _NO_SIGNALS, found)
        if not (few_vehicles and few_people):
            found.extend(self._collected(points))
        return found

    def _ask(self, domain: Any, points: Sequence[_Point], signals: Callable[[str], int], found: list[Reading]) -> None:
        position, angle, speed, lane = domain.getPosition, domain.getAngle, domain.getSpeed, domain.getLaneID
        not_before, now = self._not_before, self._reads
        for name in domain.getIDList():
            if not_before.get(name, 0) > now:
                continue
            x, y = position(name)
            nearest = min([(x - px) * (x - px) + (y - py) * (y - py) for px, py in points], default=math.inf)
            if nearest <= SIGHT_M * SIGHT_M:
                found.append((name, x, y, angle(name), speed(name), lane(name), signals(name)))
            elif nearest < _ELSEWHERE_M * _ELSEWHERE_M:
                away_m = math.sqrt(nearest) - SIGHT_M
                not_before[name] = now + int(away_m / (2.0 * FASTEST_MPS * TICK_S))

    def _collected(self, points: Sequence[_Point]) -> Iterator[Reading]:
        # SUMO measures the range of a context differently, so it is set larger, and actors out of sight are left out.
        for viewpoint in self._viewpoints:
            for name, values in libsumo.poi.getContextSubscriptionResults(viewpoint).items():
                x, y = values[libsumo.VAR_POSITION]
                if any((x - px) * (x - px) + (y - py) * (y - py) <= SIGHT_M * SIGHT_M for px, py in points):
                    angle, speed, lane = (values[variable] for variable in _PERSON_VARIABLES[1:])
                    yield name, x, y, angle, speed, lane, values.get(libsumo.VAR_SIGNALS, _NO_SIGNALS)

    def _subscriptions(self) -> Iterator[tuple[int, Sequence[int]]]:
        few_vehicles, few_people = self._few
        if not few_vehicles:
            yield libsumo.CMD_GET_VEHICLE_VARIABLE, _VEHICLE_VARIABLES
        if not few_people:
            yield libsumo.CMD_GET_PERSON_VARIABLE, _PERSON_VARIABLES
