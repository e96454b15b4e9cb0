"""Simulation: one scenario in SUMO, tick by tick. Moves the egos, applies requests, and reads the world.

SUMO's own safety must not hide faults: an ego's vehicle is integrated by `ego.dynamics`, and its SUMO proxy is moved
to it with moveToXY, so that the traffic reacts to the ego.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Mapping, Sequence
from functools import partial

import libsumo
import numpy as np

from dohyo.sumo_networks.actors.external import ExternalActors
from dohyo.sumo_networks.actors.names import ego_proxy
from dohyo.sumo_networks.actors.requests import (
    CancelVehicle,
    ClearArea,
    HideActor,
    Request,
    ShowActor,
    SpawnPedestrian,
    SpawnVehicle,
)
from dohyo.sumo_networks.actors.scripted_actor import ScriptedActor
from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.ego.fleet import NOBODY
from dohyo.sumo_networks.ego.pose import Pose
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.events.manager import EventManager
from dohyo.sumo_networks.geometry import boxes_overlap
from dohyo.sumo_networks.rules.contacts import contacts
from dohyo.sumo_networks.simulation import sumo_traffic
from dohyo.sumo_networks.simulation.external_actors import with_external
from dohyo.sumo_networks.simulation.plan import ScenarioPlan
from dohyo.sumo_networks.simulation.process import RunsOnce, failing_as_simulation_error, set_impatience, start_sumo
from dohyo.sumo_networks.simulation.proxies import SumoProxies
from dohyo.sumo_networks.simulation.registry import ActorRegistry
from dohyo.sumo_networks.simulation.scripted_actors import with_scripted
from dohyo.sumo_networks.simulation.signals import SignalReader
from dohyo.sumo_networks.simulation.sumo_frame import vehicle_box
from dohyo.sumo_networks.simulation.surroundings import Surroundings
from dohyo.sumo_networks.simulation.survey import Survey, reachable
from dohyo.sumo_networks.simulation.traffic_log import LogRecorder
from dohyo.sumo_networks.traffic.jaywalkers import Jaywalkers
from dohyo.sumo_networks.traffic.population import Population
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import Actors, Egos, World

START_CLEARANCE_M = 20.0
FASTER = 1.3  # factor on the speed limit that an ego may drive, for the range of a log


class Simulation(RunsOnce):
    """A running simulation of one scenario in SUMO; one per process at a time, since libsumo is global.

    SUMO ends with `close`, or with the last reference to the simulation.

    Attributes:
        plan: Plan of the scenario.
        world: World after the last tick.
        external: Actors of another simulator, which may be put, moved and removed between two ticks.
    """

    world: World
    _survey: Survey | None
    _everywhere: Survey | None

    def __init__(self, plan: ScenarioPlan) -> None:
        """Starts SUMO, lets the traffic warm up, places the egos at their starts, and reads the world at tick 0.

        Raises:
            InvalidInputError: The network cannot carry this traffic.
            SimulationError: SUMO failed, or another simulation of this process is open.
        """
        traffic_seed, sumo_seed, events_seed, walkers_seed = np.random.SeedSequence(plan.scenario.seed).spawn(4)
        network, traffic, traffic_rng = plan.network, plan.scenario.traffic, np.random.default_rng(traffic_seed)
        self.plan, self._tick, self._survey, self._everywhere = plan, 0, None, None
        self._fleet = plan.fleet()
        self._proxy_names = tuple(ego_proxy(name) for name in plan.egos)
        self._registry = ActorRegistry(network, plan.scenario.obstacles)
        self.external = ExternalActors()
        self._surroundings = Surroundings(traffic, len(plan.egos))
        self._proxies = SumoProxies(network, plan.vehicle, self._proxy_names)
        self._population = Population(
            network, traffic, traffic_rng, sumo_traffic.way_on_foot, partial(sumo_traffic.closed_to, network)
        )
        self._events = EventManager(network, plan.scenario.events, plan.egos, plan.routes, events_seed)
        self._jaywalkers = Jaywalkers(network, traffic.jaywalker_count, np.random.default_rng(walkers_seed))
        self._session = start_sumo(network, int(sumo_seed.generate_state(1)[0] % 2**31), plan.conditions.friction)
        self._end_sumo = weakref.finalize(self, self._session.close)
        self._end_sumo.atexit = False  # SUMO ends with the process
        try:
            self._signals = SignalReader(network)
            with failing_as_simulation_error(self._tick):
                self._warm_up()
                self._place_egos()
            self.world = self._read(self._fleet.read(None))
        except BaseException:
            self.close()
            raise

    @property
    def open(self) -> bool:
        """Whether its SUMO runs: `close` was not called, and no tick has failed."""
        return self._session.open

    def tick(self, commands: FloatArray, poses: Mapping[int, Pose] = NOBODY) -> World:
        """Advances the world by 0.1 s. A tick that fails or is interrupted closes the simulation.

        Args:
            commands: (E, 2) demanded drive [m/s^2] and front wheel angle [rad]; rows of inactive egos are ignored.
            poses: Poses after the tick of the active egos whose vehicles are simulated elsewhere.

        Raises:
            SimulationError: SUMO failed, or the simulation is closed.
        """
        self._check_open()
        try:
            self._fleet.advance(commands, TICK_S, poses)
            egos = self._fleet.read(self.world.egos)
            with failing_as_simulation_error(self._tick):
                for ego in np.flatnonzero(self._fleet.active):
                    self._show_ego(int(ego))
                if self.plan.scenario.events:
                    self._apply(self._events.update(self.world, egos, sumo_traffic.departed(), TICK_S))
                self._apply(self._jaywalkers.update(TICK_S, sumo_traffic.vehicles_near, self.plan.routes[0].edges))
                self._apply(self.external.requests(self.plan.routes[0].edges))
                self.keep_population(self._fleet.centres)
                libsumo.simulationStep()
            self._tick += 1
            self.world = self._read(egos)
        except BaseException:  # also KeyboardInterrupt: egos, SUMO and world may be a tick apart
            self.close()
            raise
        return self.world

    def keep_population(self, egos: FloatArray) -> None:
        """Replaces the vehicles and pedestrians that arrived in the last step, and sends the vehicles of flows.

        Vehicles that were removed since then count as arrived; a later call, after the next step, does not know them.

        Args:
            egos: (E, 2), m, points near which no actor should appear.
        """
        self._apply(self._population.update(*sumo_traffic.arrived(), egos))

    def retire(self, ego: int) -> None:
        """Removes an ego from the road; its row in `Egos` keeps its last values."""
        if self._fleet.active[ego]:
            self._fleet.active[ego] = False
            if self.open:
                self._surroundings.forget(self._proxy_names[ego])
                self._proxies.hide(self._proxy_names[ego])

    def record(self, recorder: LogRecorder) -> None:
        """Adds the last tick to a log: all actors near places that the egos can reach within the duration, if any.

        Raises:
            SimulationError: The simulation is closed.
        """
        self._check_open()
        if self._survey is None:
            fastest = max(float(route.speed_limit.max()) for route in self.plan.routes)
            duration_s = self.plan.scenario.duration_s
            near = None if duration_s is None else reachable(self.plan.routes, FASTER * fastest * duration_s)
            self._survey = Survey(self.plan.network, near)
        names, actors = self._survey.read(self._proxies.names, self._scripted, self._registry.obstacles())
        recorder.append(names, actors, self.world.signals, self.plan.network)

    def all_actors(self) -> tuple[list[str], Actors]:
        """Names and states of all actors of the network, except egos and external ones; keys are row numbers.

        Raises:
            SimulationError: The simulation is closed.
        """
        self._check_open()
        if self._everywhere is None:
            self._everywhere = Survey(self.plan.network, None)
        return self._everywhere.read(self._proxies.names, self._scripted, self._registry.obstacles())

    def close(self) -> None:
        """Ends SUMO; safe to call twice."""
        self._end_sumo()

    def _check_open(self) -> None:
        """SUMO is global: what reads or moves it here would otherwise do so in another simulation."""
        if not self.open:
            name = self.plan.scenario.name
            raise SimulationError(f"the simulation of scenario '{name}' is closed, or was interrupted in a tick")

    def _apply(self, requests: Iterable[Request]) -> None:
        """Carries out requests in SUMO in order; only this method adds, moves or removes actors."""
        for request in requests:
            match request:
                case SpawnVehicle():
                    sumo_traffic.spawn_vehicle(request)
                case SpawnPedestrian():
                    sumo_traffic.spawn_pedestrian(request)
                case CancelVehicle():
                    sumo_traffic.cancel_vehicle(request.name)
                case ShowActor():
                    self._proxies.show_actor(request)
                case HideActor():
                    self._proxies.hide(request.name)
                case ClearArea():
                    sumo_traffic.remove_traffic_near(request.x, request.y, request.radius_m)

    # Before tick 0.

    def _warm_up(self) -> None:
        traffic = self.plan.scenario.traffic
        if traffic.impatience:
            set_impatience(traffic.impatience)
        self._apply(self._population.fill())
        cleared = self._starts()[self._at_rest]
        for _ in range(round(traffic.warm_up_s / TICK_S)):
            self.keep_population(cleared)
            libsumo.simulationStep()

    def _place_egos(self) -> None:
        """Adds the egos to SUMO, after vehicles on their starts are removed."""
        for name, route in zip(self._proxy_names, self.plan.routes, strict=True):
            self._proxies.add_ego(name, route)
            self._surroundings.add(name)
        # Twice: a vehicle that departs in the step in which the egos enter SUMO does not react to them yet.
        for step in (1, 0):
            self._clear_starts()
            self.keep_population(self._starts())
            for ego, speed in enumerate(self.plan.start_speeds):
                self._show_ego(ego, behind_m=speed * step * TICK_S)
            libsumo.simulationStep()

    def _clear_starts(self) -> None:
        """Removes the vehicles that are too near to a start; the population replaces them elsewhere."""
        starts = self._starts()
        for name in libsumo.vehicle.getIDList():
            x, y = libsumo.vehicle.getPosition(name)
            if name not in self._proxies.names and self._in_the_way(name, np.hypot(*(starts - (x, y)).T)):
                libsumo.vehicle.remove(name)

    def _in_the_way(self, name: str, distance: FloatArray) -> bool:
        """Whether a vehicle at a distance from each start [m] must be removed."""
        near: BoolArray = distance < START_CLEARANCE_M
        if (near & self._at_rest).any():
            return True
        vehicle, egos = self.plan.vehicle, np.flatnonzero(near).tolist()
        own = [(*self._fleet.centres[ego], self._fleet.heading(ego), vehicle.length, vehicle.width) for ego in egos]
        return bool(egos and boxes_overlap(np.array(own), np.array([vehicle_box(name)])).any())

    @property
    def _at_rest(self) -> BoolArray:
        """(E,) whether an ego starts at rest, on a road that is cleared for it, and not amid the traffic."""
        return np.array([mission.start_speed_mps is None for mission in self.plan.scenario.missions], dtype=np.bool_)

    def _starts(self) -> FloatArray:
        return np.array([route.position[0] for route in self.plan.routes])

    # After each tick.

    @property
    def _scripted(self) -> Sequence[ScriptedActor]:
        """Actors in the world that SUMO does not move."""
        return [*self._events.actors, *self._jaywalkers.actors]

    def _show_ego(self, ego: int, behind_m: float = 0.0) -> None:
        x, y = self._fleet.centres[ego].tolist()
        name, route = self._proxy_names[ego], self.plan.routes[ego]
        self._proxies.show_ego(name, (x, y), self._fleet.heading(ego), route, behind_m)
        self._surroundings.move(name, x, y)

    def _read(self, egos: Egos) -> World:
        readings = [reading for reading in self._surroundings.read() if reading[0] not in self._proxies.names]
        actors = self._registry.read(readings)
        if scripted := self._scripted:
            actors = with_scripted(actors, scripted, egos, self._registry, self.plan.network)
        if len(self.external):
            actors = with_external(actors, self.external, egos, self._registry, self.plan.network)
        return World(
            tick=self._tick,
            time=self._tick * TICK_S,
            network=self.plan.network,
            routes=self.plan.routes,
            egos=egos,
            actors=actors,
            signals=self._signals.read(),
            contacts=contacts(egos, actors),
            names=self._registry.names,
            events=self._events.states(self._registry.keys),
            duties=self._signals.duties,
        )
