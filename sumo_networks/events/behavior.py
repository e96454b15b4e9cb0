"""EventBehavior: the course of one event. Every family of kinds derives from it; the manager runs it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar

import numpy as np

from dohyo.sumo_networks.actors.names import event_actor
from dohyo.sumo_networks.actors.paths import ActorPath
from dohyo.sumo_networks.actors.requests import ClearArea, Request
from dohyo.sumo_networks.actors.scripted_actor import ScriptedActor
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.events.event import BaseEvent
from dohyo.sumo_networks.world import Egos, LightState, World

if TYPE_CHECKING:  # scenarios are read without roads, whose numeric kernels take long to import
    from dohyo.sumo_networks.networks.network import RoadNetwork
    from dohyo.sumo_networks.routes.route import Route

STANDS_MPS = 0.5
IN_LANE_M = 1.5
QUEUED_S = 30.0
E = TypeVar("E", bound=BaseEvent, covariant=True)


class PlacementError(Exception):
    """An event does not fit its place; the message says why. The error does not leave `events`."""


@dataclass(frozen=True, slots=True)
class EventSite:
    """Place of an event.

    Attributes:
        trigger: Arc length of the trigger on the ego's route, m.
        network: The road network.
        route: The ego's route.
        rng: Generator of this event only.
    """

    trigger: float
    network: RoadNetwork
    route: Route
    rng: np.random.Generator


@dataclass(frozen=True)
class EventContext:
    """Input of a behaviour in one tick, and its output, the requests.

    Attributes:
        world: World after the previous tick.
        egos: Egos after this tick's motion.
        ego: Index of the event's ego.
        time: Simulated time at the end of the tick, s.
        tick_s: Length of a tick, s.
        departed: Names of the vehicles of events that have entered the road so far.
        scripted: All scripted actors of events in the world.
        requests: Requests to SUMO; behaviours append to the list.
    """

    world: World
    egos: Egos
    ego: int
    time: float
    tick_s: float
    departed: Set[str]
    scripted: Sequence[ScriptedActor]
    requests: list[Request]

    @property
    def front_m(self) -> float:
        """Arc length of the ego's front on its route, m."""
        return self.egos.progress.item(self.ego) + 0.5 * self.egos.length.item(self.ego)

    @property
    def speed(self) -> float:
        """Speed of the ego, m/s."""
        return self.egos.speed.item(self.ego)

    def distance_to(self, s: float) -> float:
        """Distance from the ego's front to a point of its route, m; negative past the point."""
        return s - self.front_m

    def time_to(self, s: float) -> float:
        """Time until the ego's front reaches a point of its route at its current speed, s."""
        return self.distance_to(s) / max(self.speed, 1e-3)

    @cached_property
    def around(self) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
        """Egos, traffic and scripted actors: (M, 5) boxes, (M,) speeds [m/s], M names (empty for egos and traffic)."""
        actors, scripted = self.world.actors, {actor.name for actor in self.scripted}
        own = np.array([self.world.names[key] not in scripted for key in actors.key], dtype=np.bool_)
        driving = np.flatnonzero(self.egos.active)
        boxes = [
            np.array([self.egos.box(int(ego)) for ego in driving]).reshape(-1, 5),
            actors.boxes()[own],
            np.array([actor.box for actor in self.scripted]).reshape(-1, 5),
        ]
        speeds = [self.egos.speed[driving], actors.speed[own], np.array([actor.speed for actor in self.scripted])]
        names = ("",) * (len(driving) + int(own.sum())) + tuple(actor.name for actor in self.scripted)
        return np.concatenate(boxes), np.concatenate(speeds), names

    def others(self, actor: ScriptedActor) -> tuple[FloatArray, FloatArray]:
        """(M, 5) boxes and (M,) speeds [m/s] of `around` without one actor."""
        boxes, speeds, names = self.around
        keep = np.array([name != actor.name for name in names], dtype=np.bool_)
        return boxes[keep], speeds[keep]


class EventBehavior(ABC, Generic[E]):
    """Course of one event, from its preparation to its end. An instance runs once.

    Only the constructor finds and checks the place; this must not depend on the generator.

    Attributes:
        event: The configuration.
        trigger: Arc length of the trigger on the ego's route, m.
        actors: Scripted actors of the event.
        path: Path along the ego's route.
        prepare_m: Distance before the trigger at which the event is prepared, m.
    """

    prepare_m: ClassVar[float] = 120.0

    def __init__(self, event: E, site: EventSite) -> None:
        self.event, self.site, self.trigger = event, site, site.trigger
        self.network, self.route, self.rng = site.network, site.route, site.rng
        self.path = ActorPath(site.route.position)
        self.actors: list[ScriptedActor] = []
        self._queued_since = math.inf

    @property
    def entered(self) -> Sequence[str]:
        """Names of the event's vehicles that SUMO drives."""
        return ()

    def prepare(self, context: EventContext) -> None:
        """Adds the actors that must be in the world before the ego sees their place."""
        for actor in self.actors:
            context.requests.append(ClearArea(actor.x, actor.y, 0.5 * actor.length + 3.0))
            actor.present = True

    def await_trigger(self, context: EventContext) -> None:
        """Advances one tick between preparation and trigger."""

    @abstractmethod
    def act(self, context: EventContext) -> bool:
        """Advances one tick after the trigger; returns True once the event is over."""

    def after(self, context: EventContext) -> None:
        """Advances one tick after the end while an ego may still see the actors: moving vehicles drive on."""
        for actor in self.actors:
            actor.drift = 0.0

    def withdraw(self, context: EventContext) -> None:
        """Cancels the event's requests that SUMO has not fulfilled yet."""

    def ahead(self, context: EventContext) -> float:
        """Distance from the ego forward to the first actor along the route, m; NaN if unknown."""
        return math.nan

    def queues(self, context: EventContext, s: float) -> bool:
        """Whether the ego has stood for 30 s behind others that stand between it and a point of its route.

        The others may wait for this event while the event waits for the ego: a deadlock. Call it in every tick.
        """
        if context.speed >= STANDS_MPS or not self._stand_before(context, s):
            self._queued_since = math.inf
            return False
        self._queued_since = min(self._queued_since, context.time)
        return context.time - self._queued_since >= QUEUED_S

    def _stand_before(self, context: EventContext, s: float) -> bool:
        boxes, speeds, names = context.around
        own = {actor.name for actor in self.actors}
        standing = [i for i, name in enumerate(names) if speeds[i] < STANDS_MPS and name not in own]
        along, left = self.path.project(boxes[standing, :2], context.front_m, s)
        return bool(((along > context.front_m) & (along < s) & (np.abs(left) < IN_LANE_M)).any())

    def actor_name(self, number: int) -> str:
        """Name of one of the event's actors."""
        return event_actor(self.event.name, number)

    def drive(self, actor: ScriptedActor, desired: float, context: EventContext, lawful: bool = False) -> None:
        """Drives an actor on the ego's route: it keeps its distance and, if `lawful`, stops at red lights."""
        gap, speed = actor.leader(*context.others(actor))
        if lawful:
            line = self._red_line(actor.s + 0.5 * actor.length, context.world)
            if line < gap:
                gap, speed = line + 1.0, 0.0
        actor.approach(desired, context.tick_s, gap, speed)

    def _red_line(self, front: float, world: World) -> float:
        """Distance from a front on the ego's route to the next line with a light that is not green, m."""
        for passage in self.route.passages:
            ahead = passage.entry > front and passage.signal >= 0
            if ahead and world.signals[passage.signal] in (LightState.RED, LightState.YELLOW):
                return passage.entry - front
        return math.inf
