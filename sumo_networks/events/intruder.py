"""Intruders: a vehicle beside the ego's lane moves into it, close ahead of the ego."""

from __future__ import annotations

import math

import numpy as np

from dohyo.sumo_networks.events.configs import Intruder
from dohyo.sumo_networks.events.puppet import ACCELERATION_MPS2, VEHICLES, Puppet
from dohyo.sumo_networks.events.roads import need_clear_road, need_kerb, section
from dohyo.sumo_networks.events.script import Moment, Script, Unfit
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route

ROOM_M = 35.0
SLOW_SHARE = 0.5
HOLD_S = 6.0
SETTLE_S = 3.0
CLOSING_SHARE = 0.3
ROOM_S = 6.0
QUEUE_GAP_M = 2.5


class IntruderScript(Script):
    """It stands at the kerb or in the lane beside, or drives there; then it moves in, and drives on as a lead does.

    Attributes:
        place: Where it stands or enters, m along the ego's route.
    """

    def __init__(
        self, event: Intruder, trigger: float, network: RoadNetwork, route: Route, rng: np.random.Generator
    ) -> None:
        super().__init__(event, trigger, network, route, rng)
        self.event, self.place = event, trigger + event.ahead_m
        self._moves = self.kind == "highway_cut_in"
        self._began, self._in = math.inf, math.inf
        if self._moves:
            limit = float(route.speed_limit[route.index(trigger)])
            need_clear_road(route, trigger, self.place + ROOM_S * limit, through=True)
        else:
            need_clear_road(route, self.place - 15.0, self.place + ROOM_M)
        self._sign = 1.0 if event.side == "left" else -1.0
        kind, length, width = VEHICLES[event.actor]
        self._beside = self._sign * self._offset(width)
        self.puppets.append(Puppet(self.puppet_named(0), kind, length, width, self.path, self.place, self._beside))
        if self.kind == "static_cut_in":  # it stands in a queue, which is why it leaves its lane
            front = self.place + length + QUEUE_GAP_M
            self.puppets.append(Puppet(self.puppet_named(1), kind, length, width, self.path, front, self._beside))

    def _offset(self, width: float) -> float:
        """From the middle of the ego's lane to where the intruder is, m."""
        event, lanes = self.event, self.network.lanes
        if self.kind == "parking_cut_in":
            found = need_kerb(self.network, self.route, self.place)
            if (found.right if event.side == "right" else found.left) >= 0 or (
                event.side == "left" and found.oncoming >= 0
            ):
                raise Unfit(f"at {self.place:.0f} m another lane is between the ego's and the {event.side} kerb")
            return (found.kerb_right if event.side == "right" else found.kerb_left) + 0.5 * width + 0.1
        found = section(self.network, self.route, self.place)
        beside = found.left if event.side == "left" else found.right
        if beside < 0:
            raise Unfit(f"at {self.place:.0f} m there is no lane to the {event.side}")
        return found.half_width + 0.5 * float(lanes.width[beside])

    def prepare(self, moment: Moment) -> None:
        """Those that stand, stand there."""
        if not self._moves:
            super().prepare(moment)

    def act(self, moment: Moment) -> bool:
        """Waits, moves in; over when it is in the lane and either the ego has gone round it or 6 s have passed."""
        one = self.puppets[0]
        if self._moves and not one.on_stage:
            self._enter(moment)
        if self._began == math.inf:
            if not self._due(moment):
                if self._moves:
                    gap = one.s - 0.5 * one.length - moment.front_m - self._wanted(moment)
                    closing = max(gap / SETTLE_S, CLOSING_SHARE * moment.speed)
                    self._drive(one, max(moment.speed - closing, 0.0), moment)
                return False
            self._began = moment.time
        self._move_in(one, moment)
        return moment.time - self._in >= HOLD_S or one.s + one.length < moment.front_m

    def _enter(self, moment: Moment) -> None:
        one = self.puppets[0]
        one.s, one.speed = moment.egos.progress.item(moment.ego) + self.event.ahead_m, moment.speed
        one.pose()
        super().prepare(moment)

    def _wanted(self, moment: Moment) -> float:
        """The gap at which one that drives moves in, m."""
        return max(self.event.minimum_distance_m, 0.5 * self.event.reaction_time_s * moment.speed)

    def _due(self, moment: Moment) -> bool:
        one, event = self.puppets[0], self.event
        rear = one.s - 0.5 * one.length
        if self._moves:
            return rear - moment.front_m <= self._wanted(moment) + 1.0
        return moment.time_to(rear) <= event.reaction_time_s or moment.distance_to(rear) <= event.minimum_distance_m

    def _move_in(self, one: Puppet, moment: Moment) -> None:
        pace = abs(self._beside) / self.event.merge_s
        target = self.event.speed_mps or SLOW_SHARE * moment.speed
        if one.left * self._sign <= pace * moment.tick_s:
            one.left, one.drift = 0.0, 0.0
            self._in = min(self._in, moment.time)
        else:
            one.drift = -self._sign * pace
        if one.speed > target:
            one.speed = max(one.speed - 2 * ACCELERATION_MPS2 * moment.tick_s, target)
        else:
            self._drive(one, target, moment)

    def _drive(self, one: Puppet, desired: float, moment: Moment) -> None:
        # What stands in the lane that it leaves does not hold it.
        if self.kind == "static_cut_in" and one.drift:
            one.approach(desired, moment.tick_s)
        else:
            self.drive(one, desired, moment)

    def after(self, moment: Moment) -> None:
        """The intruder drives on along the ego's route, the queue stays."""
        one = self.puppets[0]
        if one.left:
            self._move_in(one, moment)
        else:
            limit = float(self.route.speed_limit[self.route.index(one.s)])
            self.drive(one, limit, moment, lawful=True)

    def ahead(self, moment: Moment) -> float:
        """Of the intruder."""
        return self.puppets[0].s - moment.egos.progress.item(moment.ego)
