"""Rivals: a vehicle enters the ego's junction though it has to wait."""

from __future__ import annotations

import numpy as np

from sumo_networks.events.configs import Rival
from sumo_networks.events.puppet import VEHICLES, Puppet
from sumo_networks.events.roads import Stream, next_passage, streams
from sumo_networks.events.script import Moment, Script, Unfit
from sumo_networks.network import RoadNetwork
from sumo_networks.route import Route

CATCH_UP = 1.5


class RivalScript(Script):
    """It keeps pace with the ego, so that both would be at their meeting point at once; near to it, nothing stops it.

    Attributes:
        stream: Where it drives.
        meeting: m along the ego's route, where its front meets the middle of the rival's way.
    """

    def __init__(
        self, event: Rival, trigger: float, network: RoadNetwork, route: Route, rng: np.random.Generator
    ) -> None:
        super().__init__(event, trigger, network, route, rng)
        self.event, self._going = event, False
        self._run_up = event.speed_mps * event.reaction_time_s
        passage = next_passage(network, route, trigger)
        lit = passage.signal >= 0
        if lit != (self.kind == "opposite_runs_red_light"):
            raise Unfit(f"the junction at {passage.entry:.0f} m has {'a' if lit else 'no'} traffic light")
        self.stream = self._stream(streams(network, route, passage, 2.0 * self._run_up))
        self.meeting = self.stream.own_s
        kind, length, width = VEHICLES[event.actor]
        self._start = max(self.stream.path_s - 2.0 * self._run_up, 0.5 * length)
        self.puppets.append(Puppet(self.puppet_named(0), kind, length, width, self.stream.path, self._start))

    def _stream(self, found: list[Stream]) -> Stream:
        wanted = ("left", "right", "opposite") if self.event.comes_from == "any" else (self.event.comes_from,)
        for stream in found:
            if stream.side in wanted and stream.path_s >= self._run_up + 0.5 * VEHICLES[self.event.actor][1]:
                return stream
        raise Unfit(
            f"no way through the next junction from {' or '.join(wanted)} meets the ego's after {self._run_up:.0f} m"
        )

    def prepare(self, moment: Moment) -> None:
        """Nothing yet: the rival enters when it has to."""

    def act(self, moment: Moment) -> bool:
        """Keeps pace or goes; over when it is through the junction, or the ego."""
        rival, event = self.puppets[0], self.event
        remaining, wait = self.stream.path_s - rival.s, moment.time_to(self.meeting)
        if not rival.on_stage:
            if wait * event.speed_mps <= self.stream.path_s - self._start or self._near(moment):
                super().prepare(moment)
            return moment.distance_to(self.meeting) < -20.0
        self._going = self._going or self._near(moment)
        if self._going:
            rival.speed = event.speed_mps
        else:
            behind = remaining - event.speed_mps * wait
            rival.speed = min(max(behind / moment.tick_s, 0.0), CATCH_UP * event.speed_mps)
            rival.speed = min(rival.speed, max(remaining - self._run_up, 0.0) / moment.tick_s)
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
        gap, speed = rival.leader(*moment.others(rival))
        rival.approach(self.event.speed_mps, moment.tick_s, gap, speed)
