"""Automatic placement: events along any route, at places that fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydantic import TypeAdapter

from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.events.behavior import PlacementError
from dohyo.sumo_networks.events.placement import make_behavior
from dohyo.sumo_networks.events.registry import EVENTS, Event

if TYPE_CHECKING:  # scenarios are read without roads, whose numeric kernels take long to import
    from dohyo.sumo_networks.networks.network import RoadNetwork
    from dohyo.sumo_networks.routes.route import Route

EVERY_M = (200.0, 300.0)
FIRST_M = 30.0
SEARCH_STEP_M = 10.0
_EVENT: TypeAdapter[Event] = TypeAdapter(Event)


def auto_events(
    network: RoadNetwork,
    route: Route,
    seed: int,
    kinds: Sequence[str] | None = None,
    every_m: tuple[float, float] = EVERY_M,
    ego: str | None = None,
) -> tuple[Event, ...]:
    """Places events along a route, at random distances, of random kinds that fit.

    The distance from one trigger to the next is drawn from `every_m`; if no kind fits, the place moves on by 10 m
    until one fits. Kinds that the route has least often come first, so that a long route has many kinds. The same
    arguments give the same events.

    Args:
        network: The road network.
        route: The ego's route.
        seed: Seed of places and kinds.
        kinds: Kinds that may be placed; None: all.
        every_m: Smallest and largest distance between two triggers, m.
        ego: Mission name of the ego, part of the events' names; None: the first mission.

    Raises:
        UnknownNameError: A kind does not exist.
        InvalidInputError: The distances are not positive and in order, or not even one event fits.
    """
    chosen = tuple(EVENTS) if kinds is None else tuple(kinds)
    for kind in chosen:
        if kind not in EVENTS:
            raise UnknownNameError("kind of event", kind, EVENTS)
    low, high = every_m
    if not 0.0 < low <= high < float("inf"):
        raise InvalidInputError(f"events: expected every_m from small to large and above 0, got {list(every_m)}")
    rng = np.random.default_rng(seed)
    events: list[Event] = []
    at_start = [kind for kind in chosen if EVENTS[kind].only_at_start]
    at = 0.0 if any(_fits(kind, 0.0, network, route) for kind in at_start) else FIRST_M
    while at <= route.length:
        event = _place(chosen, [one.kind for one in events], round(at, 1), network, route, rng, ego)
        if event is None:
            at += SEARCH_STEP_M
        else:
            events.append(event)
            at += float(rng.uniform(low, high))
    if not events:
        what = "event" if kinds is None else f"event of kind {' or '.join(chosen)}"
        raise InvalidInputError(f"no {what} fits anywhere on the route of '{ego or 'ego'}', {route.length:.0f} m long")
    return tuple(events)


def _place(
    kinds: Sequence[str],
    used: Sequence[str],
    at: float,
    network: RoadNetwork,
    route: Route,
    rng: np.random.Generator,
    ego: str | None,
) -> Event | None:
    """An event of a random kind that fits, kinds used least often first; None if no kind fits."""
    drawn = [kinds[i] for i in rng.permutation(len(kinds))]
    for kind in sorted(drawn, key=used.count):
        if _fits(kind, at, network, route):
            name = "-".join([*([ego] if ego else []), f"{len(used) + 1:02d}", kind])
            return _EVENT.validate_python({"kind": kind, "name": name, "at_m": at, "ego": ego})
    return None


def _fits(kind: str, at: float, network: RoadNetwork, route: Route) -> bool:
    event = _EVENT.validate_python({"kind": kind, "name": "here", "at_m": at})
    try:
        make_behavior(event, network, route, np.random.default_rng(0))
    except PlacementError:
        return False
    return True
