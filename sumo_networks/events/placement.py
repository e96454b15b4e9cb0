"""Placement: finds the trigger of an event and checks that the event fits there, without SUMO."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.events.behavior import EventBehavior, EventSite, PlacementError
from dohyo.sumo_networks.events.event import BaseEvent

if TYPE_CHECKING:  # scenarios are read without roads, whose numeric kernels take long to import
    from dohyo.sumo_networks.networks.network import RoadNetwork
    from dohyo.sumo_networks.routes.route import Route


def make_behavior(
    event: BaseEvent, network: RoadNetwork, route: Route, rng: np.random.Generator
) -> EventBehavior[BaseEvent]:
    """Finds the place of one event.

    Raises:
        PlacementError: The event does not fit there.
    """
    trigger = trigger_of(event, network, route)
    if trigger > route.length:
        raise PlacementError(f"the route ends at {route.length:.0f} m")
    behavior: EventBehavior[BaseEvent] = type(event).behavior(event, EventSite(trigger, network, route, rng))
    return behavior


def trigger_of(event: BaseEvent, network: RoadNetwork, route: Route) -> float:
    """Arc length of an event's trigger on the route, m.

    Raises:
        PlacementError: The event's place is not on the route.
    """
    if event.at_m is not None:
        return event.at_m
    assert event.at is not None  # ensured by the event's validator
    lane = network.lane_index.get(event.at.lane)
    if lane is None:
        raise PlacementError(f"network '{network.name}' has no such lane")
    length, position = float(network.lanes.length[lane]), event.at.position_m
    if not -length <= position <= length:
        raise PlacementError(f"{position} m is off the lane, which is {length:.1f} m long")
    x, y, _ = network.lane_point(lane, position)
    distance = np.hypot(*(route.position - (x, y)).T)
    row = int(distance.argmin())
    if distance[row] > network.lanes.width[lane]:
        raise PlacementError(f"the route is {distance[row]:.0f} m away from that place")
    return row * route.length / (len(route.position) - 1)


def place_event(
    event: BaseEvent, ego: str, network: RoadNetwork, route: Route, rng: np.random.Generator
) -> EventBehavior[BaseEvent]:
    """Finds the place of one event of a scenario.

    Raises:
        InvalidInputError: The event does not fit there; the message names event, place and reason.
    """
    try:
        return make_behavior(event, network, route, rng)
    except PlacementError as reason:
        where = (
            f"at {event.at_m:g} m" if event.at is None else f"at {event.at.position_m:g} m of lane '{event.at.lane}'"
        )
        raise InvalidInputError(
            f"event '{event.name}' ({event.kind}) cannot happen {where} of the route of '{ego}': {reason}"
        ) from None


def check_placement(event: BaseEvent, ego: str, network: RoadNetwork, route: Route) -> None:
    """Checks that an event fits its place.

    Raises:
        InvalidInputError: The event does not fit; the message names event, place and reason.
    """
    place_event(event, ego, network, route, np.random.default_rng(0))
