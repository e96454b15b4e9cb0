"""Simulation: one scenario, tick by tick. Moves the egos in SUMO and reads the world after each tick.

SUMO's own safety must not hide faults: an ego is a vehicle of ours, integrated by `vehicle.py` and only *shown* to SUMO
with moveToXY, so that the traffic reacts to it. SUMO's frame (front bumper, degrees clockwise from north) ends here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import libsumo
import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.conditions import conditions_named
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.ego.fleet import EgoFleet
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.events.director import Director, check_placement
from dohyo.sumo_networks.events.puppet import Puppet
from dohyo.sumo_networks.geometry import boxes_overlap
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.rules.contacts import contacts
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.simulation.process import failing_as_simulation_error, set_impatience, start_sumo
from dohyo.sumo_networks.simulation.registry import Registry
from dohyo.sumo_networks.simulation.signals import SignalReader
from dohyo.sumo_networks.simulation.stage import SumoStage
from dohyo.sumo_networks.simulation.survey import Survey, reachable
from dohyo.sumo_networks.simulation.traffic_log import LogRecorder
from dohyo.sumo_networks.traffic.flows import make_flow_sources
from dohyo.sumo_networks.traffic.jaywalkers import Jaywalkers
from dohyo.sumo_networks.traffic.population import Population, Trip, Walk
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import Actors, Egos, World

START_CLEARANCE_M = 20.0
FASTER = 1.3  # how much faster than the limit an ego may come along
_NOWHERE: FloatArray = np.empty((0, 2))


class Simulation:
    """One scenario in SUMO. There can be one simulation per process, since libsumo is global.

    Attributes:
        network: The roads.
        scenario: What is simulated.
        routes: One per ego.
        conditions: Of road, light and air.
        vehicle: The egos' parameters, under these conditions.
    """

    _running: ClassVar[Simulation | None] = None

    def __init__(self, network: RoadNetwork, scenario: Scenario, vehicle: VehicleParameters | None = None) -> None:
        self.network = network
        self.scenario = scenario
        self.conditions = conditions_named(scenario.conditions)
        dry = vehicle or VehicleParameters()
        self.vehicle = replace(dry, friction=dry.friction * self.conditions.friction)
        self.routes: tuple[Route, ...] = tuple(plan_route(network, mission) for mission in scenario.missions)
        self._names = tuple(mission.name for mission in scenario.missions)
        self._survey: Survey | None = None
        self._images = tuple(f"ego:{name}" for name in self._names)  # no vehicle of the traffic is called so
        for event in scenario.events:
            ego = event.ego or self._names[0]
            check_placement(event, ego, network, self.routes[self._names.index(ego)])
        make_flow_sources(network, scenario.traffic.flows, np.random.default_rng(0))

    def start(self) -> World:
        """Starts SUMO, lets the traffic warm up, puts the egos at their starts, and reads the world at tick 0.

        Raises:
            InvalidInputError: The network cannot carry this traffic.
            SimulationError: SUMO failed.
        """
        traffic_seed, sumo_seed, events_seed, walkers_seed = np.random.SeedSequence(self.scenario.seed).spawn(4)
        self.close()
        if Simulation._running is not None:
            raise SimulationError("another simulation of this process is still open; close it, or use a process each")
        start_sumo(self.network, int(sumo_seed.generate_state(1)[0] % 2**31), self.conditions.friction)
        Simulation._running = self
        try:
            return self._warm_up(np.random.default_rng(traffic_seed), events_seed, np.random.default_rng(walkers_seed))
        except BaseException:
            self.close()
            raise

    def _warm_up(
        self, traffic_rng: np.random.Generator, events_seed: np.random.SeedSequence, walkers_rng: np.random.Generator
    ) -> World:
        self._fleet = EgoFleet(self.network, self._names, self.routes, self.vehicle, self._speeds())
        self._tick = 0
        self._registry = Registry(self.network, self.scenario, self.vehicle, self._images)
        self._signals = SignalReader(self.network)
        self._population = Population(self.network, self.scenario.traffic, traffic_rng)
        self._director = Director(self.network, self.scenario, self.routes, events_seed)
        self._jaywalkers = Jaywalkers(self.network, self.scenario.traffic.jaywalker_count, walkers_rng)
        self._stage = SumoStage(self.network, self._registry, self._send_newcomers)
        with failing_as_simulation_error(self._tick):
            if self.scenario.traffic.impatience:
                set_impatience(self.scenario.traffic.impatience)
            self._population.fill(self)
            for _ in range(round(self.scenario.traffic.warm_up_s / TICK_S)):
                self._population.replace_arrived(self, self._starts() if self._at_rest else _NOWHERE)
                libsumo.simulationStep()
            self._place_egos()
        self._world = self._read(self._fleet.read(None))
        return self._world

    def tick(self, commands: FloatArray) -> World:
        """Advances the world by 0.1 s.

        Args:
            commands: (E, 2) demanded drive [m/s^2] and front wheel angle [rad]; rows of inactive egos are ignored.

        Raises:
            SimulationError: SUMO failed.
        """
        self._fleet.advance(commands, TICK_S)
        egos = self._fleet.read(self._world.egos)
        with failing_as_simulation_error(self._tick):
            for ego in np.flatnonzero(self._fleet.active):
                self._show_ego(int(ego))
            if self.scenario.events:
                self._stage.note_departures()
                self._director.update(self._world, egos, TICK_S, self._stage)
            self._jaywalkers.update(TICK_S, self._stage, self.routes[0].edges)
            self._population.replace_arrived(self, self._fleet.centres)
            libsumo.simulationStep()
        self._tick += 1
        self._world = self._read(egos)
        return self._world

    def retire(self, ego: int) -> None:
        """Takes an ego off the road; its row in `Egos` keeps its last values."""
        if self._fleet.active[ego]:
            self._fleet.active[ego] = False
            self._registry.forget_ego(self._images[ego])

    def record(self, recorder: LogRecorder) -> None:
        """Adds the last tick to a log: everybody near where the egos may come within the scenario's duration."""
        if self._survey is None:
            fastest = max(float(route.speed_limit.max()) for route in self.routes)
            ahead_m = FASTER * fastest * (self.scenario.duration_s or 0.0)
            self._survey = Survey(self.network, reachable(self.routes, ahead_m))
        names, actors = self._survey.read(self._registry.images, self._cast, self._registry.obstacles())
        recorder.append(names, actors, self._world.signals)

    def everybody(self) -> Actors:
        """Everything in the whole network but the egos; keys are those of rows."""
        everywhere = Survey(self.network, None)
        return everywhere.read(self._registry.images, self._cast, self._registry.obstacles())[1]

    @property
    def _cast(self) -> list[Puppet]:
        """Those whom SUMO does not move."""
        return [*self._director.cast, *self._jaywalkers.cast]

    def close(self) -> None:
        """Ends SUMO; safe to call twice."""
        if Simulation._running is self:
            Simulation._running = None
            libsumo.close()

    # What the population asks for: traffic.Stage.

    def add_vehicle(self, name: str, trip: Trip) -> None:
        """Lets a vehicle depart as soon as there is room."""
        libsumo.route.add(name, trip.edges)
        position = "random_free" if trip.on_the_way else "base"
        lane = "best" if trip.lane is None else str(trip.lane)
        libsumo.vehicle.add(name, name, trip.type, "now", lane, position, "desired" if trip.on_the_way else "max")

    def add_pedestrian(self, name: str, walk: Walk) -> bool:
        """Lets a pedestrian set out; False if there is no way on foot."""
        stages = libsumo.simulation.findIntermodalRoute(
            walk.source, walk.target, departPos=walk.source_m, arrivalPos=walk.target_m
        )
        if len(stages) != 1 or not stages[0].edges:
            return False
        libsumo.person.add(name, walk.source, walk.source_m, typeID="pedestrian")
        libsumo.person.appendWalkingStage(name, stages[0].edges, walk.target_m)
        return True

    def arrived(self) -> tuple[Sequence[str], Sequence[str]]:
        """Names of the vehicles and of the pedestrians that reached their goal in the last tick."""
        return libsumo.simulation.getArrivedIDList(), libsumo.simulation.getArrivedPersonIDList()

    def _send_newcomers(self, cleared: Sequence[str]) -> None:
        self._population.replace(self, cleared, (), self._fleet.centres)

    # The egos in SUMO.

    def _starts(self) -> FloatArray:
        return np.array([route.position[0] for route in self.routes])

    def _place_egos(self) -> None:
        """Shows the egos to SUMO for the first time, on starts that nobody else stands on."""
        for name, route in zip(self._images, self.routes, strict=True):
            self._registry.add_ego(name, route)
        # Twice: whoever departs in the step in which SUMO first hears of the egos does not see them yet.
        for step in (1, 0):
            self._population.replace_arrived(self, self._starts())
            self._clear_starts()
            for ego, speed in enumerate(self._speeds()):
                self._show_ego(ego, behind=speed * step * TICK_S)
            libsumo.simulationStep()

    def _clear_starts(self) -> None:
        """Takes away who is too near to a start; others come for them elsewhere."""
        starts, cleared = self._starts(), []
        for name in libsumo.vehicle.getIDList():
            x, y = libsumo.vehicle.getPosition(name)
            if name not in self._images and self._in_the_way(name, np.hypot(*(starts - (x, y)).T)):
                libsumo.vehicle.remove(name)
                cleared.append(name)
        self._population.replace(self, cleared, (), starts)

    def _in_the_way(self, name: str, distance: FloatArray) -> bool:
        """Whether a vehicle, so far from each start [m], must make room."""
        if self._at_rest:
            return bool(distance.min() < START_CLEARANCE_M)
        ego = int(distance.argmin())
        if distance[ego] > START_CLEARANCE_M:
            return False
        heading = (1.5 * math.pi - math.radians(libsumo.vehicle.getAngle(name))) % (2 * math.pi) - math.pi
        x, y = libsumo.vehicle.getPosition(name)
        length, width = libsumo.vehicle.getLength(name), libsumo.vehicle.getWidth(name)
        centre = x - 0.5 * length * math.cos(heading), y - 0.5 * length * math.sin(heading)
        own = (*self._fleet.centres[ego], self._fleet.heading(ego), self.vehicle.length, self.vehicle.width)
        return bool(boxes_overlap(np.array([own]), np.array([(*centre, heading, length, width)]))[0, 0])

    @property
    def _at_rest(self) -> bool:
        return all(mission.start_speed_mps is None for mission in self.scenario.missions)

    def _speeds(self) -> list[float]:
        return [mission.start_speed_mps or 0.0 for mission in self.scenario.missions]

    def _show_ego(self, ego: int, behind: float = 0.0) -> None:
        """Moves an ego's image in SUMO, whose point of reference is the front bumper, or so far behind it [m]."""
        x, y = self._fleet.centres[ego].tolist()
        heading, half = self._fleet.heading(ego), 0.5 * self.vehicle.length - behind
        front = (x + half * math.cos(heading), y + half * math.sin(heading))
        lane, offset, _ = self.network.nearest_lane(*front, heading, self.routes[ego].on_route)
        name, lanes = self._images[ego], self.network.lanes
        on_road = lane >= 0 and abs(offset) < 0.5 * (lanes.width.item(lane) + self.vehicle.width)
        if on_road and not self._registry.strayed(name):
            place = self.network.edge_id(lane), lanes.index.item(lane)
            self._registry.move_ego(name, place, front, 90.0 - math.degrees(heading))
        else:
            self._registry.hide_image(name)
        self._registry.look_around(name, x, y)

    def _read(self, egos: Egos) -> World:
        actors = self._stage.with_cast(self._registry.read(), self._cast, egos)
        return World(
            tick=self._tick,
            time=self._tick * TICK_S,
            network=self.network,
            routes=self.routes,
            egos=egos,
            actors=actors,
            signals=self._signals.read(),
            contacts=contacts(egos, actors),
            names=self._registry.names,
            events=self._director.states(self._registry.keys),
        )
