"""FreewaySimulation: one scenario of the freeway, tick by tick; connected vehicles may be commanded.

Commands are limited by SUMO's car-following model: a commanded vehicle never follows more closely or brakes later than
its driver would.
"""

from __future__ import annotations

import itertools
import math
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Final

import libsumo
import numpy as np

from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.freeway.demand import check_incidents, draw_demand, write_routes
from dohyo.sumo_networks.freeway.drivers import CONNECTED, KINDS, PROBE
from dohyo.sumo_networks.freeway.process import MICRO, TICK_S, start_sumo
from dohyo.sumo_networks.freeway.road import FreewayRoad, MainlineLane, load_freeway
from dohyo.sumo_networks.freeway.scenario import FreewayScenario
from dohyo.sumo_networks.freeway.world import NO_LANE, FreewayWorld
from dohyo.sumo_networks.simulation.process import failing_as_simulation_error

NOTHING: Final[Mapping[str, float]] = MappingProxyType({})
HUMAN: Final = -1.0
"""SUMO's value for a vehicle whose speed is not commanded."""
SAFE: Final = 0b11011
"""SUMO's speed mode of a commanded vehicle: all checks but the one of deceleration, which would prevent braking harder
than comfortable in an emergency."""
WISH_BRAKES_MPS2: Final = 3.0
"""Hardest braking for a command, m/s^2; for a leader the vehicle may brake harder."""
_RAMP: Final = MainlineLane(math.nan, NO_LANE)


class FreewaySimulation:
    """One scenario of the freeway in SUMO. There can be one simulation per process, since libsumo is global.

    Attributes:
        scenario: Simulated scenario.
        road: The freeway.
        world: World after the last tick; there is none before `start`.
        reads_fuel: Whether the next tick reads every vehicle's fuel consumption, a sixth of the time of reading.
    """

    _running: ClassVar[FreewaySimulation | None] = None

    def __init__(self, scenario: FreewayScenario, *, fuel: bool = True) -> None:
        """Prepares a scenario.

        Args:
            scenario: Scenario to simulate.
            fuel: Initial value of `reads_fuel`.
        """
        self.scenario = scenario
        self.road: FreewayRoad = load_freeway(scenario.network)
        self.world: FreewayWorld
        self.reads_fuel = fuel

    def start(self) -> FreewayWorld:
        """Starts SUMO, simulates the warm-up, and reads the world at the scenario's start.

        Raises:
            InvalidInputError: An incident of the day lies off the road, or too soon after the beginning of the warm-up.
            SimulationError: SUMO failed, or another simulation of this process is open.
        """
        self.close()
        check_incidents(self.road, self.scenario)
        seed = np.random.SeedSequence(self.scenario.seed).spawn(6)[5]
        begin = max(self.scenario.start_s - self.scenario.warm_up_s, 0.0)
        with tempfile.TemporaryDirectory(prefix="dohyo-freeway-") as folder:
            routes = Path(folder) / "freeway.rou.xml"
            write_routes(self.road, self.scenario, draw_demand(self.road, self.scenario), routes)
            start_sumo(self.road.network.path, [routes], begin, int(seed.generate_state(1)[0] % 2**31), MICRO)
            FreewaySimulation._running = self
            try:
                return self._warm_up(begin)
            except BaseException:
                self.close()
                raise

    def tick(self, speeds: Mapping[str, float] = NOTHING, accelerations: Mapping[str, float] = NOTHING) -> FreewayWorld:
        """Advances the world by `TICK_S`.

        Args:
            speeds: Target speeds of connected vehicles by name, m/s; a vehicle reaches its target as its acceleration
                and its leader allow.
            accelerations: Accelerations of connected vehicles in this tick by name, m/s^2, within the same limits.
                A vehicle without a command drives like a human; a command that ends acts until the driver's next
                decision, up to 0.5 s later.

        Raises:
            InvalidInputError: A vehicle is not on the road, not connected or commanded twice; or a speed is negative or
                not finite.
            SimulationError: SUMO failed, or `start` was not called.
        """
        if FreewaySimulation._running is not self:
            raise SimulationError("this simulation is not running; start it first")
        self._check(speeds, accelerations)
        with failing_as_simulation_error(self._ticks):
            self._command(speeds, accelerations)
            libsumo.simulationStep()
            self._update_roster()
            self.world = self._read()
        return self.world

    def close(self) -> None:
        """Ends SUMO; safe to call twice."""
        if FreewaySimulation._running is self:
            FreewaySimulation._running = None
            libsumo.close()

    def __enter__(self) -> FreewaySimulation:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _warm_up(self, begin_s: float) -> FreewayWorld:
        self._names: dict[str, tuple[float, int, bool]] = {}  # length, kind, probe; in the order of departure
        self._commanded: set[str] = set()
        self._arrived: tuple[str, ...] = ()
        self._departed = self._ticks = 0
        with failing_as_simulation_error(0):
            for _ in range(round((self.scenario.start_s - begin_s) / TICK_S)):
                libsumo.simulationStep()
                self._update_roster()
            self.world = self._read()
        return self.world

    def _check(self, speeds: Mapping[str, float], accelerations: Mapping[str, float]) -> None:
        for name in (*speeds, *accelerations):
            facts = self._names.get(name)
            if facts is None:
                raise InvalidInputError(f"vehicle '{name}' is not on the freeway at {self.world.time_s:.1f} s")
            if KINDS[facts[1]] != CONNECTED:
                raise InvalidInputError(f"vehicle '{name}' is not connected: it cannot be commanded")
        if twice := speeds.keys() & accelerations.keys():
            raise InvalidInputError(f"vehicle '{min(twice)}' is given a speed and an acceleration: expected one")
        for name, speed in speeds.items():
            if not (math.isfinite(speed) and speed >= 0):
                raise InvalidInputError(f"vehicle '{name}': expected a speed of 0 m/s or more, got {speed}")
        for name, acceleration in accelerations.items():
            if not math.isfinite(acceleration):
                raise InvalidInputError(f"vehicle '{name}': expected a finite acceleration, got {acceleration}")

    def _command(self, speeds: Mapping[str, float], accelerations: Mapping[str, float]) -> None:
        for name in self._commanded - speeds.keys() - accelerations.keys():
            libsumo.vehicle.setSpeed(name, HUMAN)
        for name in (*speeds, *accelerations):
            if name not in self._commanded:
                libsumo.vehicle.setSpeedMode(name, SAFE)
        for name, speed in speeds.items():
            libsumo.vehicle.setSpeed(name, max(speed, libsumo.vehicle.getSpeed(name) - WISH_BRAKES_MPS2 * TICK_S))
        for name, acceleration in accelerations.items():
            change = max(acceleration, -WISH_BRAKES_MPS2) * TICK_S
            libsumo.vehicle.setSpeed(name, max(0.0, libsumo.vehicle.getSpeed(name) + change))
        self._commanded = {*speeds, *accelerations}

    def _update_roster(self) -> None:
        self._ticks += 1
        departed: Iterable[str] = libsumo.simulation.getDepartedIDList()
        for name in departed:
            kind = libsumo.vehicle.getTypeID(name)
            facts = libsumo.vehicle.getLength(name), KINDS.index(kind.removesuffix(PROBE)), kind.endswith(PROBE)
            self._names[name] = facts
            self._departed += 1
        self._arrived = tuple(libsumo.simulation.getArrivedIDList())
        for name in self._arrived:
            del self._names[name]
            self._commanded.discard(name)

    def _read(self) -> FreewayWorld:
        vehicle = libsumo.vehicle
        lanes = {name: lane for name in self._names if (lane := vehicle.getLaneID(name))}  # none while teleported
        names, number = tuple(lanes), len(lanes)
        tracks = [self.road.tracks.get(lane, _RAMP) for lane in lanes.values()]
        facts = [self._names[name] for name in names]
        length = np.array([one[0] for one in facts], dtype=np.float64)
        kind = np.array([one[1] for one in facts], dtype=np.int64)
        start = np.array([track.start_m for track in tracks], dtype=np.float64)
        fuel = map(vehicle.getFuelConsumption, names) if self.reads_fuel else itertools.repeat(math.nan, number)
        return FreewayWorld(
            road=self.road,
            time_s=float(libsumo.simulation.getTime()),
            names=names,
            position_m=start + np.fromiter(map(vehicle.getLanePosition, names), np.float64, number) - length / 2,
            lane=np.array([track.lane for track in tracks], dtype=np.int64),
            speed_mps=np.fromiter(map(vehicle.getSpeed, names), np.float64, number),
            acceleration_mps2=np.fromiter(map(vehicle.getAcceleration, names), np.float64, number),
            length_m=length,
            connected=kind == KINDS.index(CONNECTED),
            probe=np.array([one[2] for one in facts], dtype=np.bool_),
            vtype=kind,
            fuel_mg_s=np.fromiter(fuel, np.float64, number),
            departed=self._departed,
            arrived=self._arrived,
            waiting=len(libsumo.simulation.getPendingVehicles()),
        )
