"""Simulation: the only file that imports libsumo. Starts SUMO, moves the egos in it, reads the world after each tick.

SUMO's own safety must not hide faults: an ego is a vehicle of ours, integrated by `vehicle.py` and only *shown* to SUMO
with moveToXY, so that the traffic reacts to it. SUMO's frame (front bumper, degrees clockwise from north) ends here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import libsumo
import numpy as np

from sumo_networks.arrays import BoolArray, FloatArray, IntArray
from sumo_networks.conditions import conditions_named
from sumo_networks.errors import InvalidInputError, SimulationError
from sumo_networks.geometry import boxes_overlap, wrap
from sumo_networks.network import RoadNetwork
from sumo_networks.routing import Route, plan_route
from sumo_networks.scenario import Scenario
from sumo_networks.traffic import Population, Trip, Walk
from sumo_networks.vehicle import ACCELERATION, HEADING, SPEED, STEERING, YAW_RATE, VehicleParameters, Vehicles
from sumo_networks.world import SIGHT_M, ActorKind, Actors, Contact, Egos, LightState, World

TICK_S = 0.1
START_CLEARANCE_M = 20.0
_TYPES = Path(__file__).with_name("vehicle_types.add.xml")
_OPTIONS = (
    *("--step-length", str(TICK_S), "--time-to-teleport", "-1", "--lanechange.duration", "2"),
    *("--collision.action", "warn", "--collision.check-junctions", "true", "--collision.mingap-factor", "0"),
    # Two vehicles that each wait for the other inside a junction would stand for ever.
    *("--ignore-junction-blocker", "15"),
    *("--xml-validation", "never", "--no-step-log", "true", "--no-warnings", "true", "--duration-log.disable", "true"),
)
_KINDS = {
    "car": ActorKind.CAR,
    "van": ActorKind.VAN,
    "truck": ActorKind.TRUCK,
    "bus": ActorKind.BUS,
    "bicycle": ActorKind.BICYCLE,
    "pedestrian": ActorKind.PEDESTRIAN,
}
_LIGHTS = dict.fromkeys("Gg", LightState.GREEN) | dict.fromkeys("yY", LightState.YELLOW)
_LIGHTS |= dict.fromkeys("ru", LightState.RED) | dict.fromkeys("oO", LightState.OFF)
_PERSON_VARIABLES = (libsumo.VAR_POSITION, libsumo.VAR_ANGLE, libsumo.VAR_SPEED, libsumo.VAR_LANE_ID)
_VEHICLE_VARIABLES = (*_PERSON_VARIABLES, libsumo.VAR_SIGNALS)
_INDICATOR = {0: 0, 1: -1, 2: 1, 3: 0}  # SUMO's lowest two bits: right, left
_NO_SIGNALS = 0


def sumo_version() -> str:
    """Version of the SUMO in use."""
    return str(libsumo.getVersion()[1])


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
    _centres: FloatArray

    def __init__(self, network: RoadNetwork, scenario: Scenario, vehicle: VehicleParameters | None = None) -> None:
        self.network = network
        self.scenario = scenario
        self.conditions = conditions_named(scenario.conditions)
        dry = vehicle or VehicleParameters()
        self.vehicle = replace(dry, friction=dry.friction * self.conditions.friction)
        self.routes: tuple[Route, ...] = tuple(plan_route(network, mission) for mission in scenario.missions)
        self._names = tuple(mission.name for mission in scenario.missions)
        self._images = tuple(f"ego:{name}" for name in self._names)  # no vehicle of the traffic is called so

    def start(self) -> World:
        """Starts SUMO, lets the traffic warm up, puts the egos at their starts, and reads the world at tick 0.

        Raises:
            InvalidInputError: The network cannot carry this traffic.
            SimulationError: SUMO failed.
        """
        traffic_seed, sumo_seed = np.random.SeedSequence(self.scenario.seed).spawn(2)
        self._start_sumo(int(sumo_seed.generate_state(1)[0] % 2**31))
        try:
            return self._warm_up(np.random.default_rng(traffic_seed))
        except BaseException:
            self.close()
            raise

    def _warm_up(self, traffic_rng: np.random.Generator) -> World:
        count = len(self._names)
        self._vehicles = Vehicles(self.vehicle, count)
        self._active = np.ones(count, dtype=np.bool_)
        self._driven = np.zeros(count)
        self._tick = 0
        self._registry = _Registry(self.network, self.scenario, self.vehicle, self._images)
        self._signals = _Signals(self.network)
        self._population = Population(self.network, self.scenario.traffic, traffic_rng)
        with self._sumo():
            self._population.fill(self)
            for _ in range(round(self.scenario.traffic.warm_up_s / TICK_S)):
                self._population.replace_arrived(self, self._starts())
                libsumo.simulationStep()
            self._place_egos()
        self._world = self._read(None)
        return self._world

    def tick(self, commands: FloatArray) -> World:
        """Advances the world by 0.1 s.

        Args:
            commands: (E, 2) demanded drive [m/s^2] and front wheel angle [rad]; rows of inactive egos are ignored.

        Raises:
            SimulationError: SUMO failed.
        """
        before = self._centres
        frozen = self._vehicles.states[~self._active].copy()
        self._vehicles.advance(commands, TICK_S)
        self._vehicles.states[~self._active] = frozen
        self._centres = self._vehicles.centres()
        self._driven += np.hypot(*(self._centres - before).T)
        with self._sumo():
            for ego in np.flatnonzero(self._active):
                self._show_ego(int(ego))
            self._population.replace_arrived(self, self._centres)
            libsumo.simulationStep()
        self._tick += 1
        self._world = self._read(self._world)
        return self._world

    def retire(self, ego: int) -> None:
        """Takes an ego off the road; its row in `Egos` keeps its last values."""
        if self._active[ego]:
            self._active[ego] = False
            self._registry.forget_ego(self._images[ego])

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
        libsumo.vehicle.add(name, name, trip.type, "now", "best", position, "desired" if trip.on_the_way else "max")

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

    # SUMO.

    def _start_sumo(self, seed: int) -> None:
        self.close()
        if Simulation._running is not None:
            raise SimulationError("another simulation of this process is still open; close it, or use a process each")
        if not self.network.path.exists():
            raise InvalidInputError(f"network file '{self.network.path}' is gone")
        slippery = self.conditions.friction < 1.0
        options = (*_OPTIONS, "--device.friction.probability", "1") if slippery else _OPTIONS
        try:
            libsumo.start(["sumo", "-n", str(self.network.path), "-a", str(_TYPES), "--seed", str(seed), *options])
        except libsumo.TraCIException as error:
            raise SimulationError(f"SUMO could not load network '{self.network.name}': {error}") from error
        Simulation._running = self
        if slippery:
            for edge in libsumo.edge.getIDList():
                libsumo.edge.setFriction(edge, self.conditions.friction)

    @contextmanager
    def _sumo(self) -> Iterator[None]:
        try:
            yield
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            raise SimulationError(f"SUMO failed at tick {self._tick}: {error}") from error

    def _starts(self) -> FloatArray:
        return np.array([route.position[0] for route in self.routes])

    def _place_egos(self) -> None:
        """Shows the egos to SUMO for the first time, on starts that nobody else stands on."""
        for ego, (name, route) in enumerate(zip(self._images, self.routes, strict=True)):
            x, y = route.position[0].tolist()
            self._vehicles.place(ego, x, y, route.heading.item(0))
            self._registry.add_ego(name, route)
        self._centres = self._vehicles.centres()
        # Twice: whoever departs in the step in which SUMO first hears of the egos does not see them yet.
        for _ in range(2):
            self._population.replace_arrived(self, self._starts())
            self._clear_starts()
            for ego in range(len(self._names)):
                self._show_ego(ego)
            libsumo.simulationStep()

    def _clear_starts(self) -> None:
        """Takes away who is too near to a start; others come for them elsewhere."""
        starts, cleared = self._starts(), []
        for name in libsumo.vehicle.getIDList():
            x, y = libsumo.vehicle.getPosition(name)
            if name not in self._images and np.hypot(*(starts - (x, y)).T).min() < START_CLEARANCE_M:
                libsumo.vehicle.remove(name)
                cleared.append(name)
        self._population.replace(self, cleared, (), starts)

    def _show_ego(self, ego: int) -> None:
        """Moves an ego's image in SUMO, whose point of reference is the front bumper."""
        x, y = self._centres[ego].tolist()
        heading, half = self._vehicles.states.item(ego, HEADING), 0.5 * self.vehicle.length
        front = (x + half * math.cos(heading), y + half * math.sin(heading))
        lane, offset, _ = self.network.nearest_lane(*front, heading, self.routes[ego].on_route)
        name, lanes = self._images[ego], self.network.lanes
        on_road = lane >= 0 and abs(offset) < 0.5 * (lanes.width.item(lane) + self.vehicle.width)
        if on_road and not self._registry.strayed(name):
            place = self.network.edge_id(lane), lanes.index.item(lane)
            self._registry.move_ego(name, place, front, 90.0 - math.degrees(heading))
        else:
            self._registry.hide_ego(name)
        libsumo.poi.setPosition(name, x, y)

    # Reading.

    def _read(self, before: World | None) -> World:
        egos = self._read_egos(before)
        actors = self._registry.read([name for name, on in zip(self._images, self._active, strict=True) if on])
        return World(
            tick=self._tick,
            time=self._tick * TICK_S,
            network=self.network,
            routes=self.routes,
            egos=egos,
            actors=actors,
            signals=self._signals.read(),
            contacts=_contacts(egos, actors),
            names=self._registry.names,
        )

    def _read_egos(self, before: World | None) -> Egos:
        states, centres = self._vehicles.states, self._centres
        count = len(self._names)
        progress, lateral, error = np.zeros(count), np.zeros(count), np.zeros(count)
        lane, lane_offset, lane_error = np.full(count, -1), np.full(count, np.nan), np.full(count, np.nan)
        for ego, route in enumerate(self.routes):
            x, y = centres[ego].tolist()
            heading = states.item(ego, HEADING)
            near = float(before.egos.progress[ego]) if before else 0.0
            progress[ego], lateral[ego], direction = route.project(x, y, near)
            error[ego] = wrap(heading - direction)
            lane[ego], lane_offset[ego], lane_error[ego] = self.network.nearest_lane(x, y, heading, route.on_route)
        return Egos(
            names=self._names,
            active=self._active.copy(),
            position=centres,
            heading=states[:, HEADING].copy(),
            speed=states[:, SPEED].copy(),
            acceleration=states[:, ACCELERATION].copy(),
            yaw_rate=states[:, YAW_RATE].copy(),
            steering=states[:, STEERING].copy(),
            length=np.full(count, self.vehicle.length),
            width=np.full(count, self.vehicle.width),
            progress=progress,
            lateral=lateral,
            route_heading_error=error,
            lane=lane,
            lane_offset=lane_offset,
            lane_heading_error=lane_error,
            driven=self._driven.copy(),
        )


_Point = tuple[float, float]
_Row = tuple[float, float, float, float, int, int]  # x, y, angle, speed, lane, indicator


class _Registry:
    """Names, kinds and boxes of everything seen so far, and the egos' images in SUMO."""

    def __init__(
        self, network: RoadNetwork, scenario: Scenario, vehicle: VehicleParameters, egos: tuple[str, ...]
    ) -> None:
        self.names: list[str] = []
        self._vehicle = vehicle
        self._egos = frozenset(egos)
        self._lane_index = network.lane_index
        self._keys: dict[str, int] = {}
        self._kind: IntArray = np.zeros(256, dtype=np.int64)
        self._length: FloatArray = np.zeros(256)
        self._width: FloatArray = np.zeros(256)
        self._shown: set[str] = set()
        self._obstacles = np.array(
            [
                (self._register(f"obstacle-{i}", ActorKind.STATIC, o.length_m, o.width_m), o.x_m, o.y_m, o.heading_rad)
                for i, o in enumerate(scenario.obstacles)
            ]
        ).reshape(-1, 4)

    def add_ego(self, name: str, route: Route) -> None:
        libsumo.route.add(name, route.edges)
        # A context around a point of interest outlives whatever SUMO does to the ego's image.
        libsumo.poi.add(name, 0.0, 0.0, (0, 0, 0, 0))
        libsumo.poi.subscribeContext(name, libsumo.CMD_GET_VEHICLE_VARIABLE, SIGHT_M, _VEHICLE_VARIABLES)
        libsumo.poi.subscribeContext(name, libsumo.CMD_GET_PERSON_VARIABLE, SIGHT_M, _PERSON_VARIABLES)

    def move_ego(self, name: str, place: tuple[str, int], front: _Point, angle: float) -> None:
        """Shows an ego on a lane, given by its edge and index."""
        if name not in self._shown:
            self._shown.add(name)
            libsumo.vehicle.add(name, name, "ego", departLane="free", departPos="base", departSpeed="0")
            libsumo.vehicle.setLength(name, self._vehicle.length)
            libsumo.vehicle.setWidth(name, self._vehicle.width)
            libsumo.vehicle.setSpeedMode(name, 0)
            libsumo.vehicle.setLaneChangeMode(name, 0)
        libsumo.vehicle.moveToXY(name, *place, *front, angle, 2)

    def strayed(self, name: str) -> bool:
        """Whether SUMO found no lane for an ego's image, as it may past the end of one."""
        return name in self._shown and not libsumo.vehicle.getLaneID(name)

    def hide_ego(self, name: str) -> None:
        """Takes away the image of an ego that is off the road.

        SUMO keeps a vehicle that moveToXY led off the road on the books of its last lane, and dies of a segmentation
        fault when another vehicle comes along there.
        """
        if name in self._shown:
            self._shown.remove(name)
            libsumo.vehicle.remove(name)

    def forget_ego(self, name: str) -> None:
        # SUMO fails at its next step if a subscribed object is removed.
        for domain in (libsumo.CMD_GET_VEHICLE_VARIABLE, libsumo.CMD_GET_PERSON_VARIABLE):
            libsumo.poi.unsubscribeContext(name, domain, SIGHT_M)
        libsumo.poi.remove(name)
        self.hide_ego(name)

    def read(self, viewpoints: list[str]) -> Actors:
        """Everything within sight of the viewpoints, in the order of keys."""
        seen: dict[int, _Row] = {}
        for viewpoint in viewpoints:
            for name, values in libsumo.poi.getContextSubscriptionResults(viewpoint).items():
                if name in self._egos:
                    continue
                key = self._keys.get(name)
                if key is None:
                    key = self._first_sight(name)
                signals = values.get(libsumo.VAR_SIGNALS, _NO_SIGNALS)
                seen[key] = (
                    *values[libsumo.VAR_POSITION],
                    values[libsumo.VAR_ANGLE],
                    values[libsumo.VAR_SPEED],
                    self._lane_index.get(values[libsumo.VAR_LANE_ID], -1),
                    _INDICATOR[signals & 3],
                )
        return self._table(seen)

    def _table(self, seen: dict[int, _Row]) -> Actors:
        moving_keys = sorted(seen)
        moving = np.array([seen[key] for key in moving_keys]).reshape(-1, 6)
        still = len(self._obstacles)
        keys = np.empty(still + len(moving), dtype=np.int64)
        keys[:still], keys[still:] = self._obstacles[:, 0], moving_keys
        kind, length, width = self._kind[keys], self._length[keys], self._width[keys]
        position, heading, speed = np.empty((len(keys), 2)), np.empty(len(keys)), np.zeros(len(keys))
        lane, indicator = np.full(len(keys), -1), np.zeros(len(keys), dtype=np.int64)
        position[:still], heading[:still] = self._obstacles[:, 1:3], self._obstacles[:, 3]
        heading[still:] = (1.5 * math.pi - np.radians(moving[:, 2])) % (2 * math.pi) - math.pi
        # SUMO gives a vehicle's front bumper, a person's centre.
        back = np.where(kind == ActorKind.PEDESTRIAN, 0.0, 0.5 * length)[still:]
        position[still:, 0] = moving[:, 0] - back * np.cos(heading[still:])
        position[still:, 1] = moving[:, 1] - back * np.sin(heading[still:])
        speed[still:], lane[still:], indicator[still:] = moving[:, 3], moving[:, 4], moving[:, 5]
        return Actors(keys, kind, position, heading, speed, length, width, lane, indicator)

    def _first_sight(self, name: str) -> int:
        domain = libsumo.person if name.startswith("pedestrian") else libsumo.vehicle
        kind = _KINDS[domain.getTypeID(name).split("@")[0]]
        return self._register(name, kind, domain.getLength(name), domain.getWidth(name))

    def _register(self, name: str, kind: ActorKind, length: float, width: float) -> int:
        key = self._keys[name] = len(self.names)
        self.names.append(name)
        if key == len(self._kind):
            self._kind = np.concatenate([self._kind, np.zeros_like(self._kind)])
            self._length = np.concatenate([self._length, np.zeros_like(self._length)])
            self._width = np.concatenate([self._width, np.zeros_like(self._width)])
        self._kind[key], self._length[key], self._width[key] = kind, length, width
        return key


class _Signals:
    """Reads the states of all signals, decoding only lights that changed."""

    def __init__(self, network: RoadNetwork) -> None:
        signals = network.signals
        self._lights = [
            (str(light), np.flatnonzero(signals.light == i), signals.link[signals.light == i])
            for i, light in enumerate(signals.light_ids)
        ]
        self._last = [""] * len(self._lights)
        self._state: IntArray = np.zeros(len(signals.link), dtype=np.int64)

    def read(self) -> IntArray:
        """(K,) LightState."""
        for i, (light, rows, links) in enumerate(self._lights):
            text = libsumo.trafficlight.getRedYellowGreenState(light)
            if text != self._last[i]:
                self._last[i] = text
                state = self._state.copy()
                state[rows] = [_LIGHTS.get(text[link], LightState.OFF) for link in links]
                self._state = state
        return self._state


def _contacts(egos: Egos, actors: Actors) -> tuple[Contact, ...]:
    """Boxes that touch an active ego's."""
    boxes = np.column_stack([egos.position, egos.heading, egos.length, egos.width])
    found = []
    overlap = boxes_overlap(boxes, actors.boxes())
    if overlap.any():
        for ego, row in zip(*np.nonzero(overlap), strict=True):
            if egos.active[ego]:
                found.append(Contact(int(ego), int(actors.key[row]), ActorKind(actors.kind[row]), int(row)))
    if len(boxes) > 1:
        mutual: BoolArray = boxes_overlap(boxes, boxes)
        for a, b in zip(*np.nonzero(mutual), strict=True):
            if a != b and egos.active[a] and egos.active[b]:
                found.append(Contact(int(a), -1 - int(b), ActorKind.EGO, int(b)))
    return tuple(found)
