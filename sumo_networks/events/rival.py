"""Rivals: a vehicle enters the ego's junction though it has to wait."""

from __future__ import annotations

import math

import numpy as np

from dohyo.sumo_networks.events.configs import Rival
from dohyo.sumo_networks.events.puppet import VEHICLES, Puppet
from dohyo.sumo_networks.events.roads import ConflictingStream, next_passage, streams
from dohyo.sumo_networks.events.script import Moment, Script, Unfit
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route

CATCH_UP = 1.5
BEND_M_S2 = 4.0
"""How hard it takes a bend: as somebody in a hurry."""
BEND_REACH_M = 20.0
STRAIGHT, INDICATOR = "s", {"l": 1, "L": 1, "r": -1, "R": -1}


class RivalScript(Script):
    """It keeps pace with the ego, so that both would be at their meeting point at once; near to it, nothing stops it.

    Attributes:
        stream: Where it drives.
        meeting: m along the ego's route, where its front meets the middle of the rival's way.
        speed: Of the rival, m/s: the event's, or less where it turns.
    """

    def __init__(
        self, event: Rival, trigger: float, network: RoadNetwork, route: Route, rng: np.random.Generator
    ) -> None:
        super().__init__(event, trigger, network, route, rng)
        self.event, self._going = event, False
        passage = next_passage(network, route, trigger)
        lit = passage.signal >= 0
        if lit != (self.kind == "opposite_runs_red_light"):
            raise Unfit(f"the junction at {passage.entry:.0f} m has {'a' if lit else 'no'} traffic light")
        self.stream, self.speed = self._way(streams(network, route, passage, 2.0 * self._run_up(event.speed_mps)))
        self.meeting = self.stream.own_s
        self._set_off = self._run_up(self.speed)
        kind, length, width = VEHICLES[event.actor]
        self._start = max(self.stream.path_s - 2.0 * self._set_off, 0.5 * length)
        puppet = Puppet(self.puppet_named(0), kind, length, width, self.stream.path, self._start)
        puppet.indicator = INDICATOR.get(self._direction(self.stream), 0)
        self.puppets.append(puppet)

    def _way(self, found: list[ConflictingStream]) -> tuple[ConflictingStream, float]:
        """The way with the longest approach, straight on if there is one, and the speed [m/s] on it."""
        wanted = ("left", "right", "opposite") if self.event.comes_from == "any" else (self.event.comes_from,)
        for stream in sorted(found, key=lambda stream: self._direction(stream) != STRAIGHT):
            speed = self._speed_on(stream)
            if stream.side in wanted and stream.path_s >= self._run_up(speed) + 0.5 * VEHICLES[self.event.actor][1]:
                return stream, speed
        raise Unfit(
            f"no way through the next junction from {' or '.join(wanted)} meets the ego's after "
            f"{self._run_up(self.event.speed_mps):.0f} m"
        )

    def _direction(self, stream: ConflictingStream) -> str:
        return str(self.network.connections.direction[stream.connection])

    def _speed_on(self, stream: ConflictingStream) -> float:
        """The event's speed, or that of the sharpest bend around the meeting point where the way turns."""
        if self._direction(stream) == STRAIGHT:
            return self.event.speed_mps
        sharpest = stream.path.curvature(stream.path_s - BEND_REACH_M, stream.path_s + BEND_REACH_M)
        return min(self.event.speed_mps, math.sqrt(BEND_M_S2 / max(sharpest, 1e-6)))

    def _run_up(self, speed: float) -> float:
        """Metres in its reaction time."""
        return speed * self.event.reaction_time_s

    def prepare(self, moment: Moment) -> None:
        """Nothing yet: the rival enters when it has to."""

    def act(self, moment: Moment) -> bool:
        """Keeps pace or goes; over when it is through the junction, or the ego."""
        rival, speed = self.puppets[0], self.speed
        remaining, wait = self.stream.path_s - rival.s, moment.time_to(self.meeting)
        if not rival.on_stage:
            if wait * speed <= self.stream.path_s - self._start or self._near(moment):
                super().prepare(moment)
            return moment.distance_to(self.meeting) < -20.0
        self._going = self._going or self._near(moment)
        if self._going:
            rival.speed = speed
        else:
            behind = remaining - speed * wait
            rival.speed = min(max(behind / moment.tick_s, 0.0), CATCH_UP * speed)
            rival.speed = min(rival.speed, max(remaining - self._set_off, 0.0) / moment.tick_s)
        return remaining < -20.0 or rival.s > rival.path.length - rival.length

    def _near(self, moment: Moment) -> bool:
        event = self.event
        return (
            moment.time_to(self.meeting) <= event.reaction_time_s
            or moment.distance_to(self.meeting) <= event.minimum_distance_m
        )

    def after(self, moment: Moment) -> None:
        """Drives on to the end of its way."""
        rival = self.puppets[0]
        rival.indicator = 0
        gap, speed = rival.leader(*moment.others(rival))
        rival.approach(self.event.speed_mps, moment.tick_s, gap, speed)
