"""Script: how one event goes. A mechanism derives from it; the director performs it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.events.configs import BaseEvent
from dohyo.sumo_networks.events.paths import ActorPath
from dohyo.sumo_networks.events.puppet import Puppet
from dohyo.sumo_networks.events.stage import Stage
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.world import Egos, LightState, World

STANDS_MPS = 0.5
IN_LANE_M = 1.5
QUEUED_S = 30.0


class Unfit(Exception):  # noqa: N818 - not an error of the program: an answer
    """An event does not fit the place it was given; the message says why."""


@dataclass(frozen=True)
class Moment:
    """What a script sees and uses in one tick.

    Attributes:
        world: After the tick before.
        egos: After this tick's motion.
        ego: Index of the event's own.
        time: Simulated time at the end of the tick, s.
        tick_s: Length of a tick, s.
        stage: The simulation.
        cast: All puppets in the world, of all events.
    """

    world: World
    egos: Egos
    ego: int
    time: float
    tick_s: float
    stage: Stage
    cast: Sequence[Puppet]

    @property
    def front_m(self) -> float:
        """Arc length of the ego's front on its route, m."""
        return self.egos.progress.item(self.ego) + 0.5 * self.egos.length.item(self.ego)

    @property
    def speed(self) -> float:
        """Of the ego, m/s."""
        return self.egos.speed.item(self.ego)

    def distance_to(self, s: float) -> float:
        """How far the ego's front is from a point of its route, m; negative past it."""
        return s - self.front_m

    def time_to(self, s: float) -> float:
        """When the ego's front is at a point of its route if it keeps its speed, s."""
        return self.distance_to(s) / max(self.speed, 1e-3)

    @cached_property
    def around(self) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
        """Egos, other actors and puppets: (M, 5) boxes, (M,) speeds [m/s], M names (empty for egos and traffic)."""
        actors, cast = self.world.actors, {puppet.name for puppet in self.cast}
        own = np.array([self.world.names[key] not in cast for key in actors.key], dtype=np.bool_)
        driving = np.flatnonzero(self.egos.active)
        boxes = [
            np.array([self.egos.box(int(ego)) for ego in driving]).reshape(-1, 5),
            actors.boxes()[own],
            np.array([puppet.box for puppet in self.cast]).reshape(-1, 5),
        ]
        speeds = [self.egos.speed[driving], actors.speed[own], np.array([puppet.speed for puppet in self.cast])]
        names = ("",) * (len(driving) + int(own.sum())) + tuple(puppet.name for puppet in self.cast)
        return np.concatenate(boxes), np.concatenate(speeds), names

    def others(self, puppet: Puppet) -> tuple[FloatArray, FloatArray]:
        """The same without one puppet."""
        boxes, speeds, names = self.around
        keep = np.array([name != puppet.name for name in names], dtype=np.bool_)
        return boxes[keep], speeds[keep]


class Script(ABC):
    """How one event goes, from its preparation to its end. One instance performs once.

    The constructor finds the place, and is all that checks it; it must not depend on the generator.

    Attributes:
        trigger: Metres along the ego's route.
        puppets: Its actors.
        path: The ego's route.
        prepare_m: It is prepared when the ego is so far before its trigger.
    """

    prepare_m: ClassVar[float] = 120.0

    def __init__(
        self, event: BaseEvent, trigger: float, network: RoadNetwork, route: Route, rng: np.random.Generator
    ) -> None:
        self.name, self.kind, self.trigger = event.name, str(event.kind), trigger  # type: ignore[attr-defined]
        self.network, self.route, self.rng = network, route, rng
        self.path = ActorPath(route.position)
        self.puppets: list[Puppet] = []
        self._queued_since = math.inf

    @property
    def entered(self) -> Sequence[str]:
        """Names of the vehicles that SUMO drives for it."""
        return ()

    def prepare(self, moment: Moment) -> None:
        """Puts on stage what must be there before the ego sees it."""
        for puppet in self.puppets:
            moment.stage.clear(puppet.x, puppet.y, 0.5 * puppet.length + 3.0)
            puppet.on_stage = True

    def await_trigger(self, moment: Moment) -> None:  # noqa: B027 - most scripts stand still until then
        """Goes on for one tick between preparation and trigger."""

    @abstractmethod
    def act(self, moment: Moment) -> bool:
        """Goes on for one tick from the trigger on; True once it is over."""

    def after(self, moment: Moment) -> None:
        """Goes on for one tick while its actors are still to be seen: those that drive, drive on."""
        for puppet in self.puppets:
            puppet.drift = 0.0

    def withdraw(self, moment: Moment) -> None:  # noqa: B027 - most scripts have nobody waiting
        """Takes back what it has asked of the stage and not got yet."""

    def ahead(self, moment: Moment) -> float:
        """How far its first actor is ahead of the ego along its route, m; NaN where that is not known."""
        return math.nan

    def queues(self, moment: Moment, s: float) -> bool:
        """Whether the ego has stood for half a minute behind others who stand between it and a point of its route.

        They may be waiting for this very event, which would wait for the ego for ever. To be asked in every tick.
        """
        if moment.speed >= STANDS_MPS or not self._stand_before(moment, s):
            self._queued_since = math.inf
            return False
        self._queued_since = min(self._queued_since, moment.time)
        return moment.time - self._queued_since >= QUEUED_S

    def _stand_before(self, moment: Moment, s: float) -> bool:
        boxes, speeds, names = moment.around
        own = {puppet.name for puppet in self.puppets}
        standing = [i for i, name in enumerate(names) if speeds[i] < STANDS_MPS and name not in own]
        along, left = self.path.project(boxes[standing, :2], moment.front_m, s)
        return bool(((along > moment.front_m) & (along < s) & (np.abs(left) < IN_LANE_M)).any())

    def puppet_named(self, number: int) -> str:
        """The name of one of its actors."""
        return f"event:{self.name}-{number}"

    def drive(self, puppet: Puppet, desired: float, moment: Moment, lawful: bool = False) -> None:
        """Lets a puppet on the ego's route keep its distance and, where it is lawful, stop at red lights."""
        gap, speed = puppet.leader(*moment.others(puppet))
        if lawful:
            line = self._red_line(puppet.s + 0.5 * puppet.length, moment.world)
            if line < gap:
                gap, speed = line + 1.0, 0.0
        puppet.approach(desired, moment.tick_s, gap, speed)

    def _red_line(self, front: float, world: World) -> float:
        """Distance from a front on the ego's route to the next line with a light that is not green, m."""
        for passage in self.route.passages:
            ahead = passage.entry > front and passage.signal >= 0
            if ahead and world.signals[passage.signal] in (LightState.RED, LightState.YELLOW):
                return passage.entry - front
        return math.inf
