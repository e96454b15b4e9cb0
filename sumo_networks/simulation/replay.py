"""Replay: a simulation without SUMO. The egos drive freely; all other actors follow a log and do not react."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.ego.fleet import NOBODY
from dohyo.sumo_networks.ego.pose import Pose
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.rules.contacts import contacts
from dohyo.sumo_networks.simulation.plan import ScenarioPlan
from dohyo.sumo_networks.simulation.process import RunsOnce
from dohyo.sumo_networks.simulation.traffic_log import Log, logs_folder, read_log
from dohyo.sumo_networks.units import SIGHT_M, TICK_S
from dohyo.sumo_networks.world import Actors, Egos, World


class Replay(RunsOnce):
    """One scenario against a log, with the interface of `Simulation`; a process may run any number of replays.

    Scripted events do not run: their actors are in the log, as all others are.

    Attributes:
        plan: Plan of the scenario, which names the log.
        world: World after the last tick.
    """

    def __init__(self, plan: ScenarioPlan) -> None:
        """Reads the log, places the egos at their starts, and reads the world at tick 0.

        Raises:
            InvalidInputError: The scenario names no log, or the log is missing or damaged.
        """
        if plan.scenario.log is None:
            raise InvalidInputError(f"scenario '{plan.scenario.name}' names no log to replay")
        self.plan = plan
        self._log = read_log(plan.scenario.log, logs_folder())
        self._fleet = plan.fleet()
        self._open = True
        self._tick, self._next_change = 0, 0
        self._signals: IntArray = np.zeros(len(plan.network.signals.link), dtype=np.int64)
        self.world = self._read(self._fleet.read(None))

    @property
    def open(self) -> bool:
        """Whether `close` was not called."""
        return self._open

    def tick(self, commands: FloatArray, poses: Mapping[int, Pose] = NOBODY) -> World:
        """Advances the world by 0.1 s.

        Args:
            commands: (E, 2) demanded drive [m/s^2] and front wheel angle [rad]; rows of inactive egos are ignored.
            poses: Poses after the tick of the active egos whose vehicles are simulated elsewhere.

        Raises:
            SimulationError: The log has ended, or the replay is closed.
        """
        if not self._open:
            raise SimulationError(f"the replay of scenario '{self.plan.scenario.name}' is closed")
        if self._tick + 1 >= self._log.ticks:
            raise SimulationError(f"the log of scenario '{self.plan.scenario.name}' ends at tick {self._tick}")
        self._fleet.advance(commands, TICK_S, poses)
        self._tick += 1
        self.world = self._read(self._fleet.read(self.world.egos))
        return self.world

    def retire(self, ego: int) -> None:
        """Removes an ego from the road; its row in `Egos` keeps its last values."""
        self._fleet.active[ego] = False

    def close(self) -> None:
        """Ends the replay; safe to call twice."""
        self._open = False

    def _read(self, egos: Egos) -> World:
        actors = in_sight(self._log.actors(self._tick), egos)
        return World(
            tick=self._tick,
            time=self._tick * TICK_S,
            network=self.plan.network,
            routes=self.plan.routes,
            egos=egos,
            actors=actors,
            signals=self._lights(self._log),
            contacts=contacts(egos, actors),
            names=self._log.names,
        )

    def _lights(self, log: Log) -> IntArray:
        changes = log.signals
        stop = int(np.searchsorted(changes[:, 0], self._tick, side="right"))
        if stop > self._next_change:  # otherwise the same array, so that readers may skip it
            self._signals = self._signals.copy()
            for _, row, state in changes[self._next_change : stop].tolist():
                self._signals[row] = state
            self._next_change = stop
        return self._signals


def in_sight(actors: Actors, egos: Egos) -> Actors:
    """Actors that an active ego can see."""
    seen = np.zeros(len(actors), dtype=np.bool_)
    for x, y in egos.position[egos.active].tolist():
        seen |= np.hypot(actors.position[:, 0] - x, actors.position[:, 1] - y) <= SIGHT_M
    return actors.take(seen)
