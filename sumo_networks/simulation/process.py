"""SUMO in this process: start, options, and errors."""

from __future__ import annotations

import gc
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar

import libsumo

from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.units import TICK_S

DRIVERS = ("car", "van", "truck", "bus")
_TYPES = Path(__file__).parents[1] / "vehicle_types.add.xml"
_OPTIONS = (
    *("--step-length", str(TICK_S), "--time-to-teleport", "300", "--lanechange.duration", "2"),
    *("--collision.action", "warn", "--collision.check-junctions", "true", "--collision.mingap-factor", "0"),
    # Drivers know where the queues are; on shortest paths alone, all use the same street and block it.
    *("--device.rerouting.probability", "1", "--device.rerouting.period", "30"),
    # Two vehicles that wait for each other inside a junction would otherwise stand for ever.
    *("--ignore-junction-blocker", "15"),
    *("--xml-validation", "never", "--no-step-log", "true", "--no-warnings", "true", "--duration-log.disable", "true"),
)


def sumo_version() -> str:
    """Version of SUMO in use."""
    return str(libsumo.getVersion()[1])


class SumoSession:
    """SUMO in this process, from `start_sumo` until `close`.

    SUMO is global to the process, so a session closes it only while it is the latest one. One that is closed late, by
    the garbage collection, does not end the SUMO of another.
    """

    _latest: ClassVar[SumoSession | None] = None

    def __init__(self) -> None:
        SumoSession._latest = self

    @property
    def open(self) -> bool:
        """Whether this process's SUMO is the one of this session."""
        return SumoSession._latest is self

    def close(self) -> None:
        """Ends SUMO, unless that has happened or another session has begun."""
        if self.open:
            SumoSession._latest = None
            libsumo.close()


class RunsOnce(ABC):
    """A simulation, or what has one, that can be neither copied nor pickled while it runs.

    A copy would share SUMO, which is global to the process, and move the traffic of the original.
    """

    @property
    @abstractmethod
    def open(self) -> bool:
        """Whether it runs: it has begun and was not closed."""

    def __getstate__(self) -> object:
        """Supports copies and pickles of what does not run.

        Raises:
            SimulationError: It runs.
        """
        if self.open:
            raise SimulationError(
                "a running simulation cannot be copied; reset another environment with the same seed and actions"
            )
        return super().__getstate__()


def start_sumo(network: RoadNetwork, seed: int, friction: float) -> SumoSession:
    """Starts SUMO on a network, with `friction` as the share of the roads' dry grip.

    Raises:
        InvalidInputError: The network's file does not exist any more.
        SimulationError: Another simulation of this process is open, or SUMO could not load it.
    """
    if not network.path.exists():
        raise InvalidInputError(f"network file '{network.path}' does not exist any more")
    if libsumo.isLoaded():
        gc.collect()  # it may belong to a simulation that nothing refers to except itself
    if libsumo.isLoaded():
        raise SimulationError(
            "another simulation of this process is still open; close it, or use one process per simulation"
        )
    slippery = friction < 1.0
    options = (*_OPTIONS, "--device.friction.probability", "1") if slippery else _OPTIONS
    try:
        libsumo.start(["sumo", "-n", str(network.path), "-a", str(_TYPES), "--seed", str(seed), *options])
        if slippery:
            for edge in libsumo.edge.getIDList():
                libsumo.edge.setFriction(edge, friction)
        return SumoSession()
    except BaseException as error:
        libsumo.close()  # SUMO stays open after a failed load, and after one that was interrupted
        if not isinstance(error, libsumo.TraCIException):
            raise
        raise SimulationError(f"SUMO could not load network '{network.name}': {error}") from error


def set_impatience(impatience: float) -> None:
    """Sets SUMO's driver impatience, from 0 to 1; see `scenario.Traffic`."""
    for driver in DRIVERS:
        libsumo.vehicletype.setImpatience(driver, impatience)


@contextmanager
def failing_as_simulation_error(tick: int) -> Iterator[None]:
    """Turns SUMO's own errors into a SimulationError that names the tick."""
    try:
        yield
    except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
        raise SimulationError(f"SUMO failed at tick {tick}: {error}") from error
