"""Director: places the events of a scenario, and performs them tick by tick."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.events.blockage import BlockageScript
from dohyo.sumo_networks.events.configs import (
    BaseEvent,
    Blockage,
    Crossing,
    Emergency,
    Flow,
    Intruder,
    Lead,
    Oncoming,
    Rival,
    SlowBicycles,
)
from dohyo.sumo_networks.events.crossing import CrossingScript
from dohyo.sumo_networks.events.emergency import EmergencyScript
from dohyo.sumo_networks.events.flow import FlowScript
from dohyo.sumo_networks.events.intruder import IntruderScript
from dohyo.sumo_networks.events.lead import LeadScript, SlowBicyclesScript
from dohyo.sumo_networks.events.oncoming import OncomingScript
from dohyo.sumo_networks.events.puppet import Puppet
from dohyo.sumo_networks.events.rival import RivalScript
from dohyo.sumo_networks.events.script import Moment, Script, Unfit
from dohyo.sumo_networks.events.stage import Stage
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.units import SIGHT_M
from dohyo.sumo_networks.world import Egos, EventPhase, EventState, World

TRIGGER_M = 2.0
LINGER_S = 20.0
SCRIPTS: Mapping[type[BaseEvent], Any] = MappingProxyType(
    {
        Crossing: CrossingScript,
        Rival: RivalScript,
        Flow: FlowScript,
        Blockage: BlockageScript,
        Lead: LeadScript,
        SlowBicycles: SlowBicyclesScript,
        Intruder: IntruderScript,
        Oncoming: OncomingScript,
        Emergency: EmergencyScript,
    }
)
"""The mechanism of every config."""


def make_script(event: BaseEvent, network: RoadNetwork, route: Route, rng: np.random.Generator) -> Script:
    """Finds the place of one event.

    Raises:
        Unfit: It does not fit there.
    """
    trigger = trigger_of(event, network, route)
    if trigger > route.length:
        raise Unfit(f"the route ends at {route.length:.0f} m")
    script: Script = SCRIPTS[type(event)](event, trigger, network, route, rng)
    return script


def trigger_of(event: BaseEvent, network: RoadNetwork, route: Route) -> float:
    """Where an event is triggered, m along the route.

    Raises:
        Unfit: Its place is not on the route.
    """
    if event.at_m is not None:
        return event.at_m
    assert event.at is not None  # as its validator sees to
    lane = network.lane_index.get(event.at.lane)
    if lane is None:
        raise Unfit(f"network '{network.name}' has no such lane")
    x, y, _ = network.lane_point(lane, event.at.position_m)
    distance = np.hypot(*(route.position - (x, y)).T)
    row = int(distance.argmin())
    if distance[row] > network.lanes.width[lane]:
        raise Unfit(f"the route passes {distance[row]:.0f} m from there")
    return row * route.length / (len(route.position) - 1)


def check_placement(event: BaseEvent, ego: str, network: RoadNetwork, route: Route) -> None:
    """Finds out whether an event can happen where it is placed, without SUMO.

    Raises:
        InvalidInputError: It cannot; the message names event, place and reason.
    """
    _place(event, ego, network, route, np.random.default_rng(0))


def _place(event: BaseEvent, ego: str, network: RoadNetwork, route: Route, rng: np.random.Generator) -> Script:
    try:
        return make_script(event, network, route, rng)
    except Unfit as reason:
        where = (
            f"at {event.at_m:g} m" if event.at is None else f"at {event.at.position_m:g} m of lane '{event.at.lane}'"
        )
        kind = getattr(event, "kind", "event")
        raise InvalidInputError(
            f"event '{event.name}' ({kind}) cannot happen {where} of the route of '{ego}': {reason}"
        ) from None


@dataclass(slots=True)
class _Performance:
    """One script, and how far it has come."""

    script: Script
    ego: int
    timeout: float
    phase: EventPhase = EventPhase.WAITING
    prepared: bool = False
    started: float = math.nan
    ended: float = math.nan
    ahead: float = math.nan
    seen: list[str] = field(default_factory=list)

    @property
    def over(self) -> bool:
        return self.phase in (EventPhase.DONE, EventPhase.TIMED_OUT)


class Director:
    """Performs the events of one episode.

    The order in a tick is: the egos have moved, then the director, then SUMO's step. Everything random in an event
    comes from its own generator, so that one event does not change another.
    """

    def __init__(
        self, network: RoadNetwork, scenario: Scenario, routes: tuple[Route, ...], seed: np.random.SeedSequence
    ) -> None:
        """Places the events.

        Raises:
            InvalidInputError: One cannot happen where it is placed.
        """
        names = [mission.name for mission in scenario.missions]
        self._edges = [route.edges for route in routes]
        self._performances = []
        for event, child in zip(scenario.events, seed.spawn(len(scenario.events)), strict=True):
            ego = names.index(event.ego) if event.ego else 0
            script = _place(event, names[ego], network, routes[ego], np.random.default_rng(child))
            self._performances.append(_Performance(script, ego, event.timeout_s))

    @property
    def cast(self) -> list[Puppet]:
        """The puppets that are in the world."""
        return [puppet for one in self._performances for puppet in one.script.puppets if puppet.on_stage]

    def update(self, world: World, egos: Egos, tick_s: float, stage: Stage) -> None:
        """Goes on for one tick.

        Args:
            world: After the tick before.
            egos: After this tick's motion.
            tick_s: Length of a tick, s.
            stage: The simulation.
        """
        for one in self._performances:
            if one.over and not one.script.puppets:
                continue
            moment = Moment(world, egos, one.ego, world.time + tick_s, tick_s, stage, self.cast)
            self._perform(one, moment)
            self._show(one, moment)

    def states(self, keys: Mapping[str, int]) -> tuple[EventState, ...]:
        """How far the events have come.

        Args:
            keys: Of actors, by name.
        """
        return tuple(
            EventState(
                one.script.name,
                one.script.kind,
                one.ego,
                one.phase,
                one.started,
                one.ended,
                tuple(keys[name] for name in (*one.seen, *one.script.entered) if name in keys),
                one.ahead,
            )
            for one in self._performances
        )

    def _perform(self, one: _Performance, moment: Moment) -> None:
        script, progress = one.script, moment.egos.progress.item(one.ego)
        if one.over:
            self._linger(one, moment)
            return
        if not moment.egos.active[one.ego]:
            self._dismiss(one, moment)
            return
        if not one.prepared and progress >= script.trigger - script.prepare_m:
            one.prepared = True
            script.prepare(moment)
        if one.phase is EventPhase.WAITING:
            if progress <= script.trigger - TRIGGER_M:
                if one.prepared:
                    script.await_trigger(moment)
                return
            one.phase, one.started = EventPhase.ACTIVE, moment.time
        if script.act(moment):
            one.phase = EventPhase.DONE
        elif moment.time - one.started >= one.timeout:
            one.phase = EventPhase.TIMED_OUT
        one.ahead = script.ahead(moment)
        if one.over:
            one.ended = moment.time
            script.withdraw(moment)

    def _linger(self, one: _Performance, moment: Moment) -> None:
        """Actors of an event that is over leave once no ego sees them, and at the latest after 20 s."""
        one.script.after(moment)
        drivers = moment.egos.position[moment.egos.active]
        for puppet in one.script.puppets:
            hidden = all(puppet.distance(*driver) > SIGHT_M for driver in drivers.tolist())
            if hidden or moment.time - one.ended > LINGER_S:
                puppet.on_stage = False
        if not any(puppet.on_stage for puppet in one.script.puppets):
            for puppet in one.script.puppets:
                moment.stage.hide(puppet)
            one.script.puppets.clear()

    def _dismiss(self, one: _Performance, moment: Moment) -> None:
        """Ends an event whose ego has left the road."""
        if one.prepared:
            one.script.withdraw(moment)
            one.prepared = False
        if one.phase is EventPhase.ACTIVE:
            one.phase, one.ended = EventPhase.DONE, moment.time
        for puppet in one.script.puppets:
            puppet.on_stage = False

    def _show(self, one: _Performance, moment: Moment) -> None:
        for puppet in one.script.puppets:
            if not puppet.on_stage:
                moment.stage.hide(puppet)
                continue
            if puppet.name not in one.seen:
                one.seen.append(puppet.name)
            puppet.move(moment.tick_s)
            moment.stage.show(puppet, self._edges[one.ego])
