"""EventManager: runs the events of one episode, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dohyo.sumo_networks.actors.names import Role, role_of
from dohyo.sumo_networks.actors.requests import HideActor, Request, ShowActor
from dohyo.sumo_networks.actors.scripted_actor import ScriptedActor
from dohyo.sumo_networks.events.behavior import EventBehavior, EventContext
from dohyo.sumo_networks.events.event import BaseEvent
from dohyo.sumo_networks.events.placement import place_event
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.rules.episode_end import exceeds
from dohyo.sumo_networks.units import SIGHT_M
from dohyo.sumo_networks.world import Egos, EventPhase, EventState, World

TRIGGER_M = 2.0
LINGER_S = 20.0


@dataclass(slots=True)
class _Performance:
    """One event and its state. It is closed when its script has ended or its ego has left; its actors then leave."""

    behavior: EventBehavior[BaseEvent]
    ego: int
    timeout: float
    phase: EventPhase = EventPhase.WAITING
    prepared: bool = False
    started: float = math.nan
    ended: float = math.nan
    closed: float = math.nan
    ahead: float = math.nan
    seen: list[str] = field(default_factory=list)

    @property
    def over(self) -> bool:
        return self.phase in (EventPhase.DONE, EventPhase.TIMED_OUT)

    @property
    def is_closed(self) -> bool:
        return not math.isnan(self.closed)


class EventManager:
    """Runs the events of one episode.

    The order in a tick: the egos move, then the events advance, then SUMO steps. Every event has its own random
    generator, so that one event does not change another.
    """

    def __init__(
        self,
        network: RoadNetwork,
        events: Sequence[BaseEvent],
        egos: Sequence[str],
        routes: Sequence[Route],
        seed: np.random.SeedSequence,
    ) -> None:
        """Places the events.

        Args:
            network: The road network.
            events: Events of the scenario.
            egos: Names of the missions.
            routes: One route per ego.
            seed: Seed of all events.

        Raises:
            InvalidInputError: An event does not fit its place.
        """
        self._edges = [route.edges for route in routes]
        self._departed: set[str] = set()
        self._performances = []
        for event, child in zip(events, seed.spawn(len(events)), strict=True):
            ego = egos.index(event.ego) if event.ego else 0
            behavior = place_event(event, egos[ego], network, routes[ego], np.random.default_rng(child))
            self._performances.append(_Performance(behavior, ego, event.timeout_s))

    @property
    def actors(self) -> list[ScriptedActor]:
        """The scripted actors that are in the world."""
        return [actor for one in self._performances for actor in one.behavior.actors if actor.present]

    def update(self, world: World, egos: Egos, departed: Iterable[str], tick_s: float) -> list[Request]:
        """Advances all events by one tick.

        Args:
            world: World after the previous tick.
            egos: Egos after this tick's motion.
            departed: Names of the vehicles that entered the road in SUMO's last step.
            tick_s: Length of a tick, s.

        Returns:
            Requests to SUMO, in the order of application.
        """
        self._departed.update(name for name in departed if role_of(name) is Role.EVENT)
        requests: list[Request] = []
        for one in self._performances:
            if one.is_closed and not one.behavior.actors:
                continue
            context = EventContext(
                world, egos, one.ego, world.time + tick_s, tick_s, self._departed, self.actors, requests
            )
            self._perform(one, context)
            self._show(one, context)
        return requests

    def states(self, keys: Mapping[str, int]) -> tuple[EventState, ...]:
        """States of the events.

        Args:
            keys: Keys of actors, by name.
        """
        return tuple(
            EventState(
                one.behavior.event.name,
                one.behavior.event.kind,
                one.ego,
                one.phase,
                one.started,
                one.ended,
                tuple(keys[name] for name in (*one.seen, *one.behavior.entered) if name in keys),
                one.ahead,
            )
            for one in self._performances
        )

    def _perform(self, one: _Performance, context: EventContext) -> None:
        behavior, progress = one.behavior, context.egos.progress.item(one.ego)
        if one.is_closed:
            self._linger(one, context)
            return
        if not context.egos.active[one.ego]:
            self._dismiss(one, context)
            return
        if not one.prepared and progress >= behavior.trigger - behavior.prepare_m:
            one.prepared = True
            behavior.prepare(context)
        if one.phase is EventPhase.WAITING:
            if progress <= behavior.trigger - TRIGGER_M:
                if one.prepared:
                    behavior.await_trigger(context)
                return
            one.phase, one.started = EventPhase.ACTIVE, context.time
        if behavior.act(context):
            one.phase = EventPhase.DONE
        elif not exceeds(one.timeout, context.time - one.started):
            one.phase = EventPhase.TIMED_OUT
        one.ahead = behavior.ahead(context)
        if one.over:
            one.ended = one.closed = context.time
            behavior.withdraw(context)

    def _linger(self, one: _Performance, context: EventContext) -> None:
        """Moves the actors of a closed event on, as far as they have begun, until they leave."""
        if one.over:
            one.behavior.after(context)
        self._remove_unseen(one, context)

    def _remove_unseen(self, one: _Performance, context: EventContext) -> None:
        """Removes the actors of a closed event when no ego sees them, and at the latest after 20 s."""
        drivers = context.egos.position[context.egos.active]
        for actor in one.behavior.actors:
            hidden = all(actor.distance(*driver) > SIGHT_M for driver in drivers.tolist())
            if hidden or context.time - one.closed > LINGER_S:
                actor.present = False
        if not any(actor.present for actor in one.behavior.actors):
            for actor in one.behavior.actors:
                context.requests.append(HideActor(actor.name))
            one.behavior.actors.clear()

    def _dismiss(self, one: _Performance, context: EventContext) -> None:
        """Closes an event whose ego has left the road; one that had begun is done."""
        if one.phase is EventPhase.ACTIVE:
            one.phase, one.ended = EventPhase.DONE, context.time
        one.closed = context.time
        one.behavior.withdraw(context)
        self._remove_unseen(one, context)

    def _show(self, one: _Performance, context: EventContext) -> None:
        for actor in one.behavior.actors:
            if not actor.present:
                context.requests.append(HideActor(actor.name))
                continue
            if actor.name not in one.seen:
                one.seen.append(actor.name)
            actor.move(context.tick_s)
            context.requests.append(ShowActor.of(actor, self._edges[one.ego]))
