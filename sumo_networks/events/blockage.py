"""Blockages: something stands in the ego's lane, for a while or until the ego has passed it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dohyo.sumo_networks.events.configs import Blockage
from dohyo.sumo_networks.events.flow import Source, side_flow
from dohyo.sumo_networks.events.puppet import VEHICLES, Puppet
from dohyo.sumo_networks.events.roads import need_clear_road, need_kerb, next_passage, section
from dohyo.sumo_networks.events.script import Moment, Script, Unfit
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.world import ActorKind

PAST_M = 10.0
NEAR_M = 25.0
BEND_RAD = math.radians(30.0)
BEND_M = 30.0
DOOR_M = 1.0
PASSING_M = 0.6
"""How far an opened door stays from the middle of the ego's lane, m: less than half an ego's width."""


class BlockageScript(Script):
    """Boxes stand; some go after a while; it is over when the ego is past them, or they are gone.

    Attributes:
        place: Where the middle of the first of them is, m along the ego's route.
    """

    def __init__(
        self, event: Blockage, trigger: float, network: RoadNetwork, route: Route, rng: np.random.Generator
    ) -> None:
        super().__init__(event, trigger, network, route, rng)
        self.event = event
        self.place = trigger + event.ahead_m
        self.flow: Source | None = None
        self._near_since, self._began = math.inf, math.inf
        self._door: Puppet | None = None
        self._build()
        self.end = max(puppet.s + 0.5 * puppet.length for puppet in self.puppets)
        if self.end + PAST_M > route.length:
            raise Unfit(f"the route ends at {route.length:.0f} m, {self.end + PAST_M:.0f} m are needed")

    def _build(self) -> None:
        kind = self.kind.removesuffix("_two_ways")
        if kind in ("accident", "construction", "parked_obstacle"):
            self._obstacle(kind, two_ways=kind != self.kind)
        elif kind == "vehicle_opens_door":
            self._parked_with_door()
        elif kind == "parking_exit":
            self._parked_before_the_ego()
        elif kind == "blocked_intersection":
            passage = next_passage(self.network, self.route, self.trigger)
            self.place = passage.exit + 0.5 * self._size()[1] + 2.0
            self._stand(self.place)
        elif kind == "stopped_behind_curve":
            self.place = self._behind_bend()
            self._stand(self.place)
        else:
            section(self.network, self.route, self.place)
            self._stand(self.place)

    def _obstacle(self, kind: str, two_ways: bool) -> None:
        need_clear_road(self.route, self.place - 25.0, self.place + 30.0)
        found = section(self.network, self.route, self.place)
        if two_ways and found.left >= 0:
            raise Unfit(f"at {self.place:.0f} m there is a lane of the same direction to go round it")
        if not two_ways and found.left < 0 and found.right < 0:
            raise Unfit(f"at {self.place:.0f} m there is no other lane of the same direction to go round it")
        if two_ways and found.oncoming < 0:
            raise Unfit(f"there is no oncoming lane at {self.place:.0f} m")
        if self.event.gap_m is not None:
            self.flow = side_flow(self.network, self.route, self.place, self.event.gap_m, oncoming=two_ways)
        if kind == "construction":
            self._add(ActorKind.STATIC, 0.4, 1.6, self.place - 5.0)
            self._add(ActorKind.STATIC, 6.0, min(2.4, 2 * found.half_width - 0.4), self.place)
        elif kind == "accident":
            self._add(*VEHICLES["car"], self.place - 8.0, skew=0.1)
            self._add(*VEHICLES["car"], self.place, skew=-0.35)
            self._add(*VEHICLES["car"], self.place + 5.8, skew=0.2)
        else:
            self._stand(self.place, left=-0.2)

    def _parked_with_door(self) -> None:
        found = need_kerb(self.network, self.route, self.place)
        need_clear_road(self.route, self.place - 15.0, self.place + 15.0)
        if found.right >= 0:
            raise Unfit(f"at {self.place:.0f} m there is another lane between the ego's and the kerb")
        kind, length, width = self._size()
        side = PASSING_M + DOOR_M
        self._add(kind, length, width, self.place, left=-side - 0.5 * width)
        self._door = self._add(ActorKind.STATIC, 0.15, DOOR_M, self.place + 0.6, left=-side + 0.5 * DOOR_M)

    def _parked_before_the_ego(self) -> None:
        if self.trigger > 5.0:
            raise Unfit(f"it is for the start of a route, at 0 m, not at {self.trigger:.0f} m")
        need_clear_road(self.route, 0.0, self.place + 30.0)
        if section(self.network, self.route, self.place).left < 0:
            raise Unfit("there is no lane to the left of the ego's")
        self._stand(self.place)
        if self.event.gap_m is not None:
            self.flow = side_flow(self.network, self.route, self.place, self.event.gap_m, oncoming=False)
        *_, length, _ = self._size()
        self._stand(-0.5 * length - 4.5)

    def _behind_bend(self) -> float:
        heading = np.unwrap(self.route.heading)
        for s in np.arange(self.trigger + 10.0, min(self.trigger + 250.0, self.route.length - BEND_M), 1.0):
            row, before = self.route.index(float(s)), self.route.index(float(s) - BEND_M)
            bent = abs(heading[row] - heading[before]) > BEND_RAD
            straight = abs(heading[self.route.index(float(s) + 5.0)] - heading[row]) < 0.05
            if bent and straight and not any(p.entry - 5.0 < s + 5.0 < p.exit + 5.0 for p in self.route.passages):
                return float(s) + 5.0
        raise Unfit("the route has no bend of 30 degrees within 250 m")

    def _size(self) -> tuple[ActorKind, float, float]:
        kind, length, width = VEHICLES[self.event.actor]
        return kind, self.event.length_m or length, self.event.width_m or width

    def _stand(self, s: float, left: float = 0.0) -> None:
        self._add(*self._size(), s, left=left)

    def _add(
        self, kind: ActorKind, length: float, width: float, s: float, left: float = 0.0, skew: float = 0.0
    ) -> Puppet:
        name = self.puppet_named(len(self.puppets))
        self.puppets.append(Puppet(name, kind, length, width, self.path, s, left, skew=skew))
        return self.puppets[-1]

    @property
    def entered(self) -> Sequence[str]:
        """Names of the vehicles in the lane beside it."""
        return self.flow.entered if self.flow is not None else ()

    def prepare(self, moment: Moment) -> None:
        """Everything stands there before the ego sees it, but for what appears before its eyes."""
        if self.kind != "vehicle_appears":
            super().prepare(moment)
            if self._door is not None:
                self._door.on_stage = False
        self._emit(moment)

    def _emit(self, moment: Moment) -> None:
        if self.flow is not None:
            self.flow.emit(self.name, moment, self.rng)

    def await_trigger(self, moment: Moment) -> None:
        """The flow beside it comes; what blocks a junction leaves, if the ego cannot come near for those who wait."""
        self._emit(moment)
        if self.kind == "blocked_intersection" and self._leaves(moment):
            self.after(moment)

    def act(self, moment: Moment) -> bool:
        """Stands there until the ego is past, or its time is over."""
        self._emit(moment)
        if self._began == math.inf:
            self._began = moment.time
            if self.kind == "vehicle_appears":
                super().prepare(moment)
        if self._door is not None and not self._door.on_stage:
            event, near = self.event, moment.distance_to(self.place)
            self._door.on_stage = (
                near <= event.minimum_distance_m or moment.time_to(self.place) <= event.reaction_time_s
            )
        return moment.distance_to(self.end) < -PAST_M - moment.egos.length.item(moment.ego) or self._leaves(moment)

    def _leaves(self, moment: Moment) -> bool:
        if self.event.stay_s is None:
            return False
        if self.kind != "blocked_intersection" or self._is_near(moment):
            self._near_since = min(self._near_since, moment.time)
        if moment.time - self._near_since < self.event.stay_s:
            return False
        if self.kind == "vehicle_appears":
            for puppet in self.puppets:
                puppet.on_stage = False
        return True

    def _is_near(self, moment: Moment) -> bool:
        return moment.distance_to(self.place) < NEAR_M or self.queues(moment, self.place)

    def after(self, moment: Moment) -> None:
        """A single vehicle that stood for a while drives on."""
        if self.event.stay_s is not None:
            limit = float(self.route.speed_limit[self.route.index(self.puppets[0].s)])
            self.drive(self.puppets[0], limit, moment, lawful=True)

    def withdraw(self, moment: Moment) -> None:
        """The flow ends."""
        if self.flow is not None:
            self.flow.stop(moment)

    def ahead(self, moment: Moment) -> float:
        """Of the first box."""
        return self.puppets[0].s - moment.egos.progress.item(moment.ego)
