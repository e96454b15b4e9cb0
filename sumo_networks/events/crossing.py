"""Crossing actors: people and bicycles who cross the ego's lane from the side, hidden or not, one or many."""

from __future__ import annotations

import math

import numpy as np

from dohyo.sumo_networks.events.configs import Crossing
from dohyo.sumo_networks.events.paths import ActorPath
from dohyo.sumo_networks.events.puppet import VEHICLES, Puppet
from dohyo.sumo_networks.events.roads import Section, crossing_after, need_kerb, next_passage, turns
from dohyo.sumo_networks.events.script import Moment, Script, Unfit
from dohyo.sumo_networks.geometry import boxes_overlap
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.world import ActorKind

BEHIND_JUNCTION = ("pedestrian_group_crossing", "cyclist_after_turn", "pedestrian_after_turn", "crossing_bicycle_flow")
BEHIND_TURN = ("cyclist_after_turn", "pedestrian_after_turn")
KERB_M = 0.6
PATIENCE_M = 1.0
STANDING_MPS = 0.5


class CrossingScript(Script):
    """They wait at the kerb, and cross so that the first meets the front of an ego that keeps its speed.

    They set out at the distance that they cover within the reaction time, or at the kerb where that is farther away;
    in the second case they set out earlier. Nobody walks into an ego that stands.

    Attributes:
        line: Where they cross, m along the ego's route.
        run_up: From where they set out to the middle of the ego's lane, m.
    """

    def __init__(
        self, event: Crossing, trigger: float, network: RoadNetwork, route: Route, rng: np.random.Generator
    ) -> None:
        super().__init__(event, trigger, network, route, rng)
        self.event = event
        self.line, section = self._line()
        sign = 1.0 if event.side == "left" else -1.0
        near, far = section.kerb_right, section.kerb_left
        if event.side == "left":
            near, far = far, near
        self.run_up = max(near + KERB_M, event.reaction_time_s * event.speed_mps)
        self._reach = self.run_up + far + KERB_M + 1.0
        self._started = math.inf
        self._paused: dict[str, float] = {}
        kind = ActorKind.PEDESTRIAN if event.actor == "pedestrian" else ActorKind.BICYCLE
        for number in range(event.count):
            along, behind = (
                (0.0, number * event.spacing_m) if event.actor == "bicycle" else (number * event.spacing_m, 0.0)
            )
            way = self._way(self.line + along, sign)
            name = self.puppet_named(number)
            self.puppets.append(Puppet(name, kind, event.length_m, event.width_m, way, -behind, across=True))
        self._hide_behind(sign, near)

    def _line(self) -> tuple[float, Section]:
        event, network, route = self.event, self.network, self.route
        if self.kind not in BEHIND_JUNCTION:
            line = self.trigger + event.ahead_m
            found = need_kerb(network, route, line)
            if line + 5.0 > route.length:
                raise Unfit(f"the route ends at {route.length:.0f} m")
            return line, found
        passage = next_passage(network, route, self.trigger)
        if self.kind in BEHIND_TURN and not turns(passage):
            raise Unfit(f"the route goes straight on at the junction at {passage.entry:.0f} m")
        return crossing_after(network, route, passage), need_kerb(network, route, passage.exit + 1.0)

    def _way(self, line: float, sign: float) -> ActorPath:
        start, end = self.path.at(line, sign * self.run_up), self.path.at(line, sign * (self.run_up - self._reach))
        return ActorPath(np.array([start[:2], end[:2]]))

    def _hide_behind(self, sign: float, kerb: float) -> None:
        if self.event.occluder == "none":
            return
        parked = self.event.occluder == "parked_car"
        kind, length, width = VEHICLES["car"] if parked else (ActorKind.STATIC, 1.6, 1.0)
        before, beside = self.line - 0.5 * length - 0.8, kerb + 0.5 * width + (0.1 if parked else 0.3)
        name = self.puppet_named(self.event.count)
        self.puppets.append(Puppet(name, kind, length, width, self.path, before, sign * beside))

    @property
    def walkers(self) -> list[Puppet]:
        """Those who cross."""
        return self.puppets[: self.event.count]

    def act(self, moment: Moment) -> bool:
        """Sets them out when it is time, and lets them walk to the other side."""
        if self._started == math.inf and self._due(moment):
            self._started = moment.time
        if self._started < math.inf:
            for walker in self.walkers:
                self._walk(walker, moment)
        return all(walker.s >= self._reach for walker in self.walkers)

    def _due(self, moment: Moment) -> bool:
        event, distance = self.event, moment.distance_to(self.line)
        return distance <= event.minimum_distance_m or moment.time_to(self.line) <= self.run_up / event.speed_mps

    def _walk(self, walker: Puppet, moment: Moment) -> None:
        paused = self._paused.get(walker.name, 0.0)
        waits = walker.s >= self.run_up and paused < self.event.pause_s
        if waits:
            self._paused[walker.name] = paused + moment.tick_s
        if waits or walker.s >= self._reach or _runs_into_standing_ego(walker, moment):
            walker.speed = 0.0
        else:
            walker.speed = self.event.speed_mps

    def after(self, moment: Moment) -> None:
        """Those who are not across yet, go on."""
        for walker in self.walkers:
            if self._started < math.inf:
                self._walk(walker, moment)


def _runs_into_standing_ego(walker: Puppet, moment: Moment) -> bool:
    x, y, heading, length, width = walker.box
    half = 0.5 * PATIENCE_M
    ahead = np.array(
        [[x + half * math.cos(heading), y + half * math.sin(heading), heading, length + PATIENCE_M, width + 0.4]]
    )
    for ego in np.flatnonzero(moment.egos.active):
        standing = moment.egos.speed[ego] < STANDING_MPS
        if standing and boxes_overlap(ahead, moment.egos.box(int(ego))[None])[0, 0]:
            return True
    return False
