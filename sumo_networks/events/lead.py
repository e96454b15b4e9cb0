"""Leads: who drives ahead of the ego in its lane, and brakes; or rides slowly at the lane's side."""

from __future__ import annotations

import math

import numpy as np

from dohyo.sumo_networks.events.configs import Lead, SlowBicycles
from dohyo.sumo_networks.events.puppet import VEHICLES, Puppet
from dohyo.sumo_networks.events.roads import need_clear_road, section
from dohyo.sumo_networks.events.script import Moment, Script, Unfit
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.world import ActorKind

SETTLE_S = 3.0
CLOSING_SHARE = 0.3
BRAKING_ROOM_S = 4.0
PAST_M = 10.0
FREE_M = 20.0


class LeadScript(Script):
    """A vehicle enters ahead, lets the ego come near, brakes, stands, and drives on."""

    def __init__(
        self, event: Lead, trigger: float, network: RoadNetwork, route: Route, rng: np.random.Generator
    ) -> None:
        super().__init__(event, trigger, network, route, rng)
        limit = float(route.speed_limit[route.index(trigger)])
        need_clear_road(route, trigger, trigger + event.appear_m + BRAKING_ROOM_S * limit, through=True)
        self.event = event
        self._came, self._braked = math.inf, math.inf
        kind, length, width = VEHICLES[event.actor]
        start = trigger + event.appear_m
        self.puppets.append(Puppet(self.puppet_named(0), kind, length, width, self.path, start))

    def prepare(self, moment: Moment) -> None:
        """Nothing yet: how fast it drives depends on the ego."""

    def act(self, moment: Moment) -> bool:
        """Enters, waits for the ego, brakes; over when it may drive on."""
        lead, event = self.puppets[0], self.event
        if not lead.on_stage:
            self._enter(moment)
        gap = lead.s - 0.5 * lead.length - moment.front_m
        if self._braked == math.inf and (gap <= event.gap_m or moment.time - self._came >= event.wait_s):
            self._braked = moment.time
        if self._braked == math.inf:
            closing = max((gap - event.gap_m) / SETTLE_S, CLOSING_SHARE * moment.speed)
            self.drive(lead, max(moment.speed - closing, 0.0), moment)
            return False
        lead.speed = max(lead.speed - event.deceleration_mps2 * moment.tick_s, 0.0)
        return moment.time - self._braked >= event.stop_s

    def _enter(self, moment: Moment) -> None:
        lead = self.puppets[0]
        lead.s = moment.egos.progress.item(moment.ego) + self.event.appear_m
        lead.speed = moment.speed
        lead.pose()
        super().prepare(moment)
        x, y, _ = self.path.at(lead.s - 0.5 * self.event.appear_m)
        moment.stage.clear(x, y, max(0.5 * self.event.appear_m - 6.0, 0.0))
        self._came = moment.time

    def after(self, moment: Moment) -> None:
        """Drives on along the ego's route, and waits at red lights."""
        lead = self.puppets[0]
        limit = float(self.route.speed_limit[self.route.index(lead.s)])
        self.drive(lead, limit, moment, lawful=True)

    def ahead(self, moment: Moment) -> float:
        """Of the lead."""
        return self.puppets[0].s - moment.egos.progress.item(moment.ego)


class SlowBicyclesScript(Script):
    """They ride until the ego has overtaken them all, or they come to a junction."""

    def __init__(
        self, event: SlowBicycles, trigger: float, network: RoadNetwork, route: Route, rng: np.random.Generator
    ) -> None:
        super().__init__(event, trigger, network, route, rng)
        last = trigger + event.ahead_m
        first = last + (event.count - 1) * event.spacing_m
        need_clear_road(route, last - 10.0, first + FREE_M)
        found = section(network, route, last)
        if found.right >= 0:
            raise Unfit(f"at {last:.0f} m the ego's lane is not the rightmost")
        self._speed = event.speed_mps
        self._end = next((p.entry for p in route.passages if p.entry > first), route.length) - 5.0
        left = -(found.half_width - event.from_edge_m)
        self.puppets += [
            Puppet(
                self.puppet_named(number),
                ActorKind.BICYCLE,
                1.7,
                0.65,
                self.path,
                last + number * event.spacing_m,
                left,
            )
            for number in range(event.count)
        ]

    def act(self, moment: Moment) -> bool:
        """Rides on."""
        self._ride(moment)
        return all(not one.on_stage or one.s + 0.5 * one.length < moment.front_m - PAST_M for one in self.puppets)

    def after(self, moment: Moment) -> None:
        """Rides on."""
        self._ride(moment)

    def _ride(self, moment: Moment) -> None:
        for one in self.puppets:
            gap, speed = one.leader(*moment.others(one))
            one.approach(self._speed, moment.tick_s, gap, speed)
            one.on_stage = one.on_stage and one.s < self._end

    def ahead(self, moment: Moment) -> float:
        """Of the last of them."""
        return self.puppets[0].s - moment.egos.progress.item(moment.ego)
