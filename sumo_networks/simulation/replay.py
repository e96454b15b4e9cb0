"""Replay: a simulation without SUMO. The egos drive as ever; everybody else does what a log says, whatever they do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.conditions import conditions_named
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.ego.fleet import EgoFleet
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.rules.contacts import contacts
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.simulation.traffic_log import Log, logs_folder, read_log
from dohyo.sumo_networks.units import SIGHT_M, TICK_S
from dohyo.sumo_networks.world import Actors, Egos, World


class Replay:
    """One scenario against a log, with the interface of `Simulation`; any number of them in a process.

    Scripted events are not performed: their actors are in the log, as everybody else is.

    Attributes:
        network: The roads.
        scenario: What is simulated; it names the log.
        routes: One per ego.
        conditions: Of road, light and air.
        vehicle: The egos' parameters, under these conditions.
    """

    def __init__(self, network: RoadNetwork, scenario: Scenario, vehicle: VehicleParameters | None = None) -> None:
        """Plans the routes; the log is read at `start`.

        Raises:
            InvalidInputError: The scenario names no log, or a mission cannot be driven.
        """
        if scenario.log is None:
            raise InvalidInputError(f"scenario '{scenario.name}' names no log to replay")
        self.network, self.scenario = network, scenario
        self.conditions = conditions_named(scenario.conditions)
        dry = vehicle or VehicleParameters()
        self.vehicle = replace(dry, friction=dry.friction * self.conditions.friction)
        self.routes: tuple[Route, ...] = tuple(plan_route(network, mission) for mission in scenario.missions)
        self._names = tuple(mission.name for mission in scenario.missions)

    def start(self) -> World:
        """Puts the egos at their starts, and reads the world at tick 0.

        Raises:
            InvalidInputError: The log is missing or damaged.
        """
        assert self.scenario.log is not None
        self._log = read_log(self.scenario.log, logs_folder())
        speeds = [mission.start_speed_mps or 0.0 for mission in self.scenario.missions]
        self._fleet = EgoFleet(self.network, self._names, self.routes, self.vehicle, speeds)
        self._tick, self._next_change = 0, 0
        self._signals: IntArray = np.zeros(len(self.network.signals.link), dtype=np.int64)
        self._world = self._read(self._fleet.read(None))
        return self._world

    def tick(self, commands: FloatArray) -> World:
        """Advances the world by 0.1 s.

        Args:
            commands: (E, 2) demanded drive [m/s^2] and front wheel angle [rad]; rows of inactive egos are ignored.

        Raises:
            SimulationError: The log has ended.
        """
        if self._tick + 1 >= self._log.ticks:
            raise SimulationError(f"the log of scenario '{self.scenario.name}' ends at tick {self._tick}")
        self._fleet.advance(commands, TICK_S)
        self._tick += 1
        self._world = self._read(self._fleet.read(self._world.egos))
        return self._world

    def retire(self, ego: int) -> None:
        """Takes an ego off the road; its row in `Egos` keeps its last values."""
        self._fleet.active[ego] = False

    def close(self) -> None:
        """Nothing to end."""

    def _read(self, egos: Egos) -> World:
        actors = in_sight(self._log.actors(self._tick), egos)
        return World(
            tick=self._tick,
            time=self._tick * TICK_S,
            network=self.network,
            routes=self.routes,
            egos=egos,
            actors=actors,
            signals=self._lights(self._log),
            contacts=contacts(egos, actors),
            names=self._log.names,
        )

    def _lights(self, log: Log) -> IntArray:
        changes = log.signals
        stop = int(np.searchsorted(changes[:, 0], self._tick, side="right"))
        if stop > self._next_change:  # else the same array: who reads it may skip what did not change
            self._signals = self._signals.copy()
            for _, row, state in changes[self._next_change : stop].tolist():
                self._signals[row] = state
            self._next_change = stop
        return self._signals


def in_sight(actors: Actors, egos: Egos) -> Actors:
    """Those actors that an active ego can see."""
    seen = np.zeros(len(actors), dtype=np.bool_)
    for x, y in egos.position[egos.active].tolist():
        seen |= np.hypot(actors.position[:, 0] - x, actors.position[:, 1] - y) <= SIGHT_M
    return actors.take(seen)
