"""Emergency: a vehicle with blue light comes from behind, and wants to pass."""

from __future__ import annotations

import math

import numpy as np

from dohyo.sumo_networks.events.configs import Emergency
from dohyo.sumo_networks.events.paths import ActorPath, lane_path, upstream
from dohyo.sumo_networks.events.puppet import VEHICLES, Puppet
from dohyo.sumo_networks.events.roads import section
from dohyo.sumo_networks.events.script import Moment, Script, Unfit
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route

CLOSE_M = 25.0
PASSED_M = 5.0
AHEAD_M = 150.0
CLEARED_M = 12.0
TYPE = "emergency"


class EmergencyScript(Script):
    """It follows the ego's route at its own speed, through red lights, and never runs into anybody.

    Over when its rear is 5 m ahead of the ego's front; or when it has been close behind for too long, in which case the
    ego did not yield. It then drives on, or goes once nobody sees it.
    """

    prepare_m = 0.0

    def __init__(
        self, event: Emergency, trigger: float, network: RoadNetwork, route: Route, rng: np.random.Generator
    ) -> None:
        super().__init__(event, trigger, network, route, rng)
        self.event = event
        self._check_room()
        self._before = 0.0
        lanes = upstream(network, int(route.lane[0]), event.behind_m + float(network.lanes.length[route.lane[0]]))
        short = max(event.behind_m - trigger, 0.0)
        if short > 0.0:
            self._extend(lanes, short)
        kind, length, width = VEHICLES[TYPE]
        start = self._before + trigger - event.behind_m
        self.puppets.append(Puppet(self.puppet_named(0), kind, length, width, self.path, start))
        self._close = math.inf

    def _check_room(self) -> None:
        if self.trigger + AHEAD_M > self.route.length:
            raise Unfit(f"the route ends at {self.route.length:.0f} m, {self.trigger + AHEAD_M:.0f} m are needed")
        for ahead in np.arange(self.trigger, self.trigger + AHEAD_M, 10.0):
            try:
                found = section(self.network, self.route, float(ahead))
            except Unfit:
                continue
            if found.left < 0 and found.right < 0:
                raise Unfit(f"at {ahead:.0f} m there is no second lane to let it pass")

    def _extend(self, lanes: list[int], short: float) -> None:
        """Lets the path begin before the route does, on the lanes that lead there."""
        back = lane_path(self.network, lanes)
        s, _ = back.project(self.route.position[:1], 0.0, back.length)
        begin = float(s[0]) - short
        if begin < 0.0:
            raise Unfit(f"only {float(s[0]) + self.trigger:.0f} m of road lie behind the trigger")
        rows = (back.arc >= begin) & (back.arc < float(s[0]) - 1.0)
        whole = ActorPath(np.concatenate([back.points[rows], self.route.position]))
        self._before, self.path = whole.length - self.path.length, whole

    def prepare(self, moment: Moment) -> None:
        """Nothing yet: it enters behind the ego, wherever that is."""

    def act(self, moment: Moment) -> bool:
        """Comes near; over when it has passed, or waited too long."""
        vehicle = self.puppets[0]
        if not vehicle.on_stage:
            vehicle.s = max(self._before + moment.egos.progress.item(moment.ego) - self.event.behind_m, 0.0)
            vehicle.speed = self.event.speed_mps
            vehicle.pose()
            super().prepare(moment)
        self._hurry(moment)
        behind = -self.ahead(moment)
        if behind < CLOSE_M:
            self._close = min(self._close, moment.time)
        reach = 0.5 * (vehicle.length + moment.egos.length.item(moment.ego))
        return behind < -(reach + PASSED_M) or moment.time - self._close >= self.event.wait_s

    def _hurry(self, moment: Moment) -> None:
        vehicle = self.puppets[0]
        # The traffic makes room; where it cannot, as before a red light, it must not be what holds the vehicle up.
        nose = vehicle.s + 0.5 * vehicle.length + CLEARED_M
        if nose < self._before + moment.egos.progress.item(moment.ego) - CLEARED_M or self.ahead(moment) > 0:
            moment.stage.clear(*self.path.at(nose)[:2], 0.5 * CLEARED_M)
        self.drive(vehicle, self.event.speed_mps, moment)

    def after(self, moment: Moment) -> None:
        """Drives on."""
        self._hurry(moment)

    def ahead(self, moment: Moment) -> float:
        """Of the emergency vehicle."""
        return self.puppets[0].s - self._before - moment.egos.progress.item(moment.ego)
