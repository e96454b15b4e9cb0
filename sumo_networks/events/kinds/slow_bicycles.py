"""Bicycles that ride slowly at the side of the ego's lane."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from dohyo.sumo_networks.actors.scripted_actor import ScriptedActor
from dohyo.sumo_networks.events.behavior import EventBehavior, EventContext, EventSite, PlacementError
from dohyo.sumo_networks.events.event import BaseEvent, Metres, Speed
from dohyo.sumo_networks.events.roads import need_clear_road, section
from dohyo.sumo_networks.units import KMH_PER_MPS
from dohyo.sumo_networks.world import ActorKind

PAST_M = 10.0
FREE_M = 20.0


class SlowBicyclesBehavior(EventBehavior["SlowBicycles"]):
    """The bicycles ride until the ego has overtaken all of them, or until they reach a junction."""

    def __init__(self, event: SlowBicycles, site: EventSite) -> None:
        super().__init__(event, site)
        network, route, trigger = site.network, site.route, site.trigger
        last = trigger + event.ahead_m
        first = last + (event.count - 1) * event.spacing_m
        need_clear_road(route, last - 10.0, first + FREE_M)
        found = section(network, route, last)
        if found.right >= 0:
            raise PlacementError(f"at {last:.0f} m the ego's lane is not the rightmost")
        self._speed = event.speed_mps
        self._end = next((p.entry for p in route.passages if p.entry > first), route.length) - 5.0
        left = -(found.half_width - event.from_edge_m)
        self.actors += [
            ScriptedActor(
                self.actor_name(number),
                ActorKind.BICYCLE,
                1.7,
                0.65,
                self.path,
                last + number * event.spacing_m,
                left,
            )
            for number in range(event.count)
        ]

    def act(self, context: EventContext) -> bool:
        """Moves the bicycles."""
        self._ride(context)
        return all(not one.present or one.s + 0.5 * one.length < context.front_m - PAST_M for one in self.actors)

    def after(self, context: EventContext) -> None:
        """Moves the bicycles."""
        self._ride(context)

    def _ride(self, context: EventContext) -> None:
        for one in self.actors:
            gap, speed = one.leader(*context.others(one))
            one.approach(self._speed, context.tick_s, gap, speed)
            one.present = one.present and one.s < self._end

    def ahead(self, context: EventContext) -> float:
        """Distance to the last bicycle, m."""
        return self.actors[0].s - context.egos.progress.item(context.ego)


class SlowBicycles(BaseEvent):
    """Bicycles ride slowly at the side of the ego's lane.

    Attributes:
        ahead_m: Distance from the trigger to the last bicycle, m.
        count: Number of bicycles.
        spacing_m: Distance between two bicycles, m.
        speed_mps: Speed of each bicycle, m/s.
        from_edge_m: Distance from the edge of the lane to the middle of a bicycle, m.
    """

    behavior: ClassVar = SlowBicyclesBehavior

    kind: Literal["slow_bicycles"] = "slow_bicycles"
    ahead_m: Metres = 50.0
    count: Annotated[int, Field(ge=1, le=20)] = 3
    spacing_m: Annotated[float, Field(ge=2, le=100)] = 9.0
    speed_mps: Speed = 10 / KMH_PER_MPS
    from_edge_m: Metres = 0.7
