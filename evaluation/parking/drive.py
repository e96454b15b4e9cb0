"""Drives of an agent in the lots of a benchmark."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np

from dohyo.evaluation.blame import RAISED, is_blameless
from dohyo.evaluation.parking.agent import ParkingAgent
from dohyo.evaluation.parking.benchmark import ParkingBenchmark, scene_of
from dohyo.evaluation.parking.deadlines import Limit, unlimited
from dohyo.evaluation.parking.record import Ending, KartRecord, ParkingRecord
from dohyo.evaluation.records.record import AgentInfo
from dohyo.sumo_networks.arrays import Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.errors import AgentError
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.observation import columns
from dohyo.sumo_networks.parking.radar import Kind
from dohyo.sumo_networks.parking.rules import JUDGED, Outcome
from dohyo.sumo_networks.parking.tables import WALK_X, WALK_Y
from dohyo.sumo_networks.parking.world import ParkingWorld

_ENDINGS: dict[Outcome, Ending] = {
    Outcome.PARKED: "parked",
    Outcome.COLLIDED: "collided",
    Outcome.TIMED_OUT: "timed_out",
}
_DECIMALS = 9
_SHOWN = [kart.X, kart.Y, kart.HEADING, kart.SPEED]
_FULL_BRAKE = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class Drive:
    """The drive of all karts in one lot, with the walks of its pedestrians.

    Attributes:
        record: The facts.
        motion: (T, K + P, 4) x, y [m], heading [rad], speed [m/s] of karts, then of pedestrians, at the beginning and
            after each tick. A pedestrian has heading and speed 0.
    """

    record: ParkingRecord
    motion: Float32Array


def drive_lots(
    benchmark: ParkingBenchmark,
    seeds: Sequence[int],
    agents: Sequence[ParkingAgent],
    info: AgentInfo,
    limit: Limit = unlimited,
) -> Iterator[Drive]:
    """Drives lots one after the other; see `drive_lot`."""
    world = ParkingWorld(1, benchmark.karts)
    for seed in seeds:
        yield drive_lot(world, benchmark, seed, agents, info, limit=limit)


def drive_lot(
    world: ParkingWorld,
    benchmark: ParkingBenchmark,
    seed: int,
    agents: Sequence[ParkingAgent],
    info: AgentInfo,
    show: Callable[[int, Mapping[int, Float32Array]], None] = lambda tick, observations: None,
    limit: Limit = unlimited,
) -> Drive:
    """Drives one lot until every kart's episode has ended; a kart whose agent fails brakes and ends as failed.

    Args:
        world: A world with one lot and the benchmark's number of karts.
        benchmark: Benchmark of the lot.
        seed: Seed of the lot.
        agents: One per kart.
        info: Description of the agent, for the record.
        show: Called before the decisions of each tick, with its number and the observations of the karts that decide.
        limit: Limits the time of each call of an agent.
    """
    world.draw([0], [seed], scene_of(benchmark.scene), JUDGED)
    drivers = [_Driver(agent, number, seed, limit) for number, agent in enumerate(agents)]
    motion = [_places(world)]
    while (running := world.running[0]).any():
        actions = np.tile(_FULL_BRAKE, (1, world.karts, 1))
        deciding = [driver for driver in drivers if running[driver.number] and not driver.failure]
        if deciding:
            show(len(motion) - 1, {driver.number: driver.observation(world) for driver in deciding})
        for driver in deciding:
            actions[0, driver.number] = driver.action(world, len(motion) - 1)
        if all(drivers[number].failure for number in np.flatnonzero(running)):
            break
        world.step(actions)
        motion.append(_places(world))
    moved = np.stack(motion)
    karts = tuple(_record(world, driver) for driver in drivers)
    record = ParkingRecord(
        benchmark=benchmark,
        seed=seed,
        agent=info,
        version=version("dohyo"),
        karts=karts,
        motion_sha256=hashlib.sha256(moved.tobytes()).hexdigest(),
    )
    return Drive(record.sealed(), moved)


def _places(world: ParkingWorld) -> Float32Array:
    """(K + P, 4) one row of `Drive.motion`."""
    view = world.view(0)
    walkers = np.zeros((len(view.walkers), len(_SHOWN)))
    walkers[:, :2] = view.walkers[:, [WALK_X, WALK_Y]]
    return np.concatenate([view.karts[:, _SHOWN], walkers]).astype(np.float32)


class _Driver:
    """An agent in its kart; it answers with full brake once it has failed, in the tick `failed_at`."""

    def __init__(self, agent: ParkingAgent, number: int, seed: int, limit: Limit) -> None:
        self.agent, self.number, self.failure, self.failed_at = agent, number, "", 0
        self._columns: IntArray = columns(agent.spec.state)
        self._limit = limit
        try:
            with limit("reset", number, agent):
                agent.reset(seed)
        except RAISED as error:
            self.failure = self._failure("reset", error)

    def observation(self, world: ParkingWorld) -> Float32Array:
        """Columns of the present observation that the agent sees."""
        return np.asarray(world.observations[0, self.number, self._columns])

    def action(self, world: ParkingWorld, tick: int) -> FloatArray:
        """(3,) the agent's action for the present observation, that of a tick."""
        self.failed_at = tick
        try:
            with self._limit("act", self.number, self.agent):
                if self.agent.spec.track == "privileged":
                    self.agent.look(world.view(0).frozen(), self.number)
                given = self.agent.act(self.observation(world))
            whole = np.asarray(given)
            action = np.asarray(whole.real, np.float64)
        except RAISED as error:
            self.failure = self._failure("act", error)
            return _FULL_BRAKE
        if action.shape != (3,) or not np.isfinite(action).all() or np.iscomplexobj(whole):
            what = "complex numbers" if np.iscomplexobj(whole) else f"shape {action.shape}"
            self.failure = f"expected 3 finite numbers as action, got {what}: {given!r:.60}"
            return _FULL_BRAKE
        return action

    def _failure(self, call: str, error: BaseException) -> str:
        """What went wrong in a call; an error that is not the agent's is raised again."""
        if is_blameless(error, self.agent):
            raise error
        if isinstance(error, AgentError):  # its message is already written for people
            return str(error)
        return f"{call} raised {type(error).__name__}: {error}"


def _record(world: ParkingWorld, driver: _Driver) -> KartRecord:
    results, at = world.results(), (0, driver.number)
    time_s = driver.failed_at * kart.TICK_S if driver.failure else float(results.time_s[at])
    ending: Ending = "failed" if driver.failure else _ENDINGS[Outcome(int(results.outcome[at]))]
    return KartRecord(
        ending=ending,
        aligned=bool(results.aligned[at]) and not driver.failure,
        time_s=round(time_s, _DECIMALS),
        inclination_deg=round(math.degrees(float(results.inclination_rad[at])), _DECIMALS),
        deviation_m=round(float(results.deviation_m[at]), _DECIMALS),
        distance_m=round(float(results.distance_m[at]), _DECIMALS),
        driven_m=round(float(results.driven_m[at]), _DECIMALS),
        shunts=int(results.shunts[at]),
        touched=Kind(int(results.touched[at])).name.lower(),
        failure=driver.failure.splitlines()[0] if driver.failure else None,
    )
