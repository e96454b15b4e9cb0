"""Oncoming vehicles that come into the ego's lane."""

from __future__ import annotations

import math

import numpy as np

from dohyo.sumo_networks.events.configs import Oncoming
from dohyo.sumo_networks.events.paths import ActorPath
from dohyo.sumo_networks.events.puppet import VEHICLES, Puppet
from dohyo.sumo_networks.events.roads import need_clear_road, section
from dohyo.sumo_networks.events.script import Moment, Script, Unfit
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route

CHANGE_S = 1.2
BACK_M = 15.0


class OncomingScript(Script):
    """They come along the ego's route the other way, in their own lane; before they meet it, they move over, and back.

    Their path is the ego's route from its far end, so "left" on it is the ego's right.
    """

    def __init__(
        self, event: Oncoming, trigger: float, network: RoadNetwork, route: Route, rng: np.random.Generator
    ) -> None:
        super().__init__(event, trigger, network, route, rng)
        self.event = event
        far = trigger + event.appear_m
        need_clear_road(route, trigger, far, through=True)
        found = section(network, route, trigger + 0.5 * event.appear_m)
        if found.oncoming < 0 or section(network, route, far).oncoming < 0:
            raise Unfit(f"there is no oncoming lane between {trigger:.0f} and {far:.0f} m")
        if found.left >= 0:
            raise Unfit(f"at {trigger:.0f} m there is a lane of the same direction between the ego and those oncoming")
        kind, length, width = VEHICLES[event.actor]
        self._own = -(found.middle + 0.5 * float(network.lanes.width[found.oncoming]))
        self._over = 0.0 if event.intrusion_m is None else -(found.middle - event.intrusion_m + 0.5 * width)
        back = ActorPath(self.path.points[: route.index(far) + 1][::-1])
        self._length = back.length
        self.puppets += [
            Puppet(self.puppet_named(n), kind, length, width, back, -n * event.spacing_m, self._own)
            for n in range(event.count)
        ]
        self._since: dict[str, float] = {}

    def prepare(self, moment: Moment) -> None:
        """Nothing yet: they enter at the trigger."""

    def act(self, moment: Moment) -> bool:
        """They come, move over, move back; over when all are past the ego."""
        if self.puppets[0].s == 0.0 and not self.puppets[0].on_stage:
            super().prepare(moment)
        for puppet in self.puppets:
            self._steer(puppet, moment)
        own = self._length - (moment.front_m - moment.egos.length.item(moment.ego))
        return all(not puppet.on_stage or puppet.s - 0.5 * puppet.length > own + 5.0 for puppet in self.puppets)

    def _steer(self, puppet: Puppet, moment: Moment) -> None:
        event = self.event
        gap = self._length - puppet.s - 0.5 * puppet.length - moment.front_m
        closing = event.speed_mps + moment.speed
        past = gap < -moment.egos.length.item(moment.ego) - puppet.length
        if not past and gap / closing <= event.reaction_time_s:
            self._since.setdefault(puppet.name, moment.time)
        began = self._since.get(puppet.name, math.inf)
        over = began < math.inf and moment.time - began < event.return_s and not past
        self._shift(puppet, self._over if over else self._own, moment.tick_s)
        puppet.speed = event.speed_mps
        if puppet.s > self._length:
            puppet.on_stage = False

    def _shift(self, puppet: Puppet, target: float, seconds: float) -> None:
        pace = abs(self._own - self._over) / CHANGE_S
        remaining = target - puppet.left
        if abs(remaining) <= pace * seconds:
            puppet.left, puppet.drift = target, 0.0
        else:
            puppet.drift = math.copysign(pace, remaining)

    def after(self, moment: Moment) -> None:
        """They drive on in their own lane to where the ego began."""
        for puppet in self.puppets:
            self._shift(puppet, self._own, moment.tick_s)
            gap, speed = puppet.leader(*moment.others(puppet))
            puppet.approach(self.event.speed_mps, moment.tick_s, gap, speed)
            if puppet.s > self._length:
                puppet.on_stage = False

    def ahead(self, moment: Moment) -> float:
        """Of the first of them."""
        return self._length - self.puppets[0].s - moment.egos.progress.item(moment.ego)
