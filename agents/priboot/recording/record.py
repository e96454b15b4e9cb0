"""Recording: a demonstrator drives, with events of the leaderboard on half of its routes, and noise on most of them.

    dohyo dataset priboot --out out/priboot/demonstrations --samples 80000
    dohyo dataset priboot --out out/priboot/of-pdm --samples 80000 --demonstrator pdm-closed
    dohyo dataset priboot --out out/priboot/obstacles-2 --samples 40000 --seed 2 --obstacles lanes
    dohyo dataset priboot --out out/priboot/doors-4 --samples 12000 --seed 4 --obstacles doors
    dohyo dataset priboot --out out/priboot/takeovers --samples 15000 --seed 1 --learner out/priboot/full/priboot.onnx

Network, missions, events, traffic, noise and displacements of an episode follow from its number and the seed alone. An
interrupted recording goes on where it stopped, and the same order gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict
from itertools import count
from pathlib import Path

import numpy as np

from dohyo.agents.driving import decisions
from dohyo.agents.learning.files.card import digest
from dohyo.agents.priboot import measurements
from dohyo.agents.priboot.measurements import BlockTime, measured
from dohyo.agents.priboot.priboot import Priboot
from dohyo.agents.priboot.recording.dataset import (
    SCHEMA_VERSION,
    VIEWS,
    WAYPOINT_S,
    WAYPOINTS,
    Moments,
    load_shard,
)
from dohyo.agents.priboot.recording.displacement import MOVING_M_S, displaced, drawn_displacement
from dohyo.agents.priboot.recording.disturbance import STARTS, Bursts, Disturbance
from dohyo.agents.priboot.recording.halts import Halts
from dohyo.agents.priboot.recording.intention import intended
from dohyo.agents.priboot.recording.scenarios import NETWORKS, OBSTACLES, MomentRequest, scenario
from dohyo.agents.priboot.recording.takeover import Takeovers
from dohyo.agents.priboot.view import SENSOR, packed
from dohyo.agents.registry import resolve
from dohyo.agents.shards import claim_folder
from dohyo.evaluation.agent import Agent, make_agent
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.sensors import Observation, Sensor, make_sensors
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import World

VALIDATION_EVERY = 4
CONTROL = "acceleration_steering"
STANDS_M, KEPT_STANDING = 0.1, 6
"""An ego that goes no farther in two seconds stands; one in so many of such moments is kept."""
HELD_M_S, KEPT_HELD = 0.3, 3
"""An ego that is slower than this in a stall is held; one in so many of such moments is kept."""
_AHEAD = tuple(round((j + 1) * WAYPOINT_S / TICK_S) for j in range(WAYPOINTS))


def record_moments(order: MomentRequest, out: Path, progress: Callable[[int], None] = lambda moments: None) -> int:
    """Records until there are enough moments; existing episodes are kept.

    Args:
        order: What to record.
        out: Folder; see `dataset`.
        progress: Called with the number of moments so far, after every episode.

    Returns:
        Number of moments.

    Raises:
        InvalidInputError: The order is impossible, or the folder holds a dataset of another order.
        UnknownNameError: There is no such demonstrator, or no such obstacles.
    """
    if order.obstacles and order.obstacles not in OBSTACLES:
        raise UnknownNameError("obstacles", order.obstacles, OBSTACLES)
    if order.obstacles and order.learner:
        raise InvalidInputError(f"expected obstacles or a learner, got both, '{order.obstacles}' and '{order.learner}'")
    if order.samples < 1 or order.egos < 1 or order.every_s < TICK_S or order.episode_s < WAYPOINTS * WAYPOINT_S:
        raise InvalidInputError(f"expected samples, egos, and times of a tick and two seconds at least, got {order}")
    demonstrator(order.demonstrator).close()
    document = {name: value for name, value in asdict(order).items() if name != "samples"}
    if order.learner:
        _learner(order).close()
        document["learner_sha256"] = digest(Path(order.learner))
    claim_folder(out, {"schema": SCHEMA_VERSION, **document})
    moments = 0
    for episode in count():
        network, number = NETWORKS[episode % len(NETWORKS)], episode // len(NETWORKS)
        moments += sum(len(load_shard(path)) for path in _recorded(order, out, network, number))
        progress(moments)
        if moments >= order.samples:
            return moments
    raise AssertionError("unreachable")


def _recorded(order: MomentRequest, out: Path, network: str, number: int) -> list[Path]:
    """Shards of one episode, which is driven unless they are all there."""
    folder = out / ("validation" if number % VALIDATION_EVERY == VALIDATION_EVERY - 1 else "train")
    paths = [folder / f"{network}-{number:04d}-{ego}.npz" for ego in range(order.egos)]
    if not all(path.exists() for path in paths):
        folder.mkdir(parents=True, exist_ok=True)
        for path, drive in zip(paths, record_episode(scenario(order, network, number), order), strict=True):
            write_atomically(path, drive.to_bytes())
    return paths


def record_episode(scenario: Scenario, order: MomentRequest) -> list[Moments]:
    """Drives one scenario, and returns the moments of each ego."""
    names = [mission.name for mission in scenario.missions]
    agents = {name: demonstrator(order.demonstrator) for name in names}
    spec = agents[names[0]].spec
    drives = [Drive(scenario, ego, disturbance(order, scenario, ego)) for ego in range(len(names))]
    disturbed = Priboot.spec.sensors if order.learner or order.obstacles else ()
    sensors = dict.fromkeys((*spec.sensors, *disturbed))
    stride = max(round(order.every_s / TICK_S), 1)
    with closing(DrivingEnv(scenario, tuple(sensors), spec.control, reward=None)) as env:
        for now in decisions(env, agents, round(order.episode_s / TICK_S)):
            for name, action in now.actions.items():
                drive, seen = drives[names.index(name)], now.observations[name]
                now.actions[name] = drive.tick(env.world, seen, np.asarray(action), now.tick % stride == 0)
    return [drive.moments() for drive in drives]


def demonstrator(name: str) -> Agent:
    """The agent of a name.

    Raises:
        InvalidInputError: Its actions are not acceleration and steering.
        UnknownNameError: There is no such agent.
    """
    agent = make_agent(resolve(name), {})
    if agent.spec.control != CONTROL:
        raise InvalidInputError(f"demonstrator '{name}': expected actions of {CONTROL}, got {agent.spec.control}")
    return agent


def disturbance(order: MomentRequest, scenario: Scenario, ego: int) -> Disturbance | None:
    """What disturbs an ego; none for every third."""
    rng = _generator(scenario, ego).spawn(1)[0]
    if ego % 3 == 0:
        return None
    if order.obstacles:
        return Halts(rng)
    if not order.learner:
        return Bursts(rng)
    return Takeovers(_learner(order), scenario.missions[ego], rng)


def _learner(order: MomentRequest) -> Agent:
    """The agent whose mistakes are recorded.

    Raises:
        InvalidInputError: Its file is no policy.
    """
    return make_agent(resolve("priboot"), {"policy": order.learner})


def _generator(scenario: Scenario, ego: int) -> np.random.Generator:
    return np.random.default_rng([scenario.seed, SCHEMA_VERSION, ego])


class Drive:
    """One ego's drive as it is recorded."""

    def __init__(self, scenario: Scenario, ego: int, noise: Disturbance | None) -> None:
        self._ego, self._rng, self._noise = ego, _generator(scenario, ego), noise
        self._sensors = make_sensors((SENSOR, *measurements.SENSORS), conditions=Conditions())
        self._blocked = BlockTime()
        self._poses: list[tuple[float, float, float]] = []
        self._noisy: list[bool] = []
        self._moments: list[tuple[int, list[tuple[FloatArray, np.ndarray, Float32Array]]]] = []
        self._held: dict[int, FloatArray] = {}
        self._waiting: list[int] = []
        self._released: dict[int, int] = {}

    def tick(self, world: World, observation: Observation, action: FloatArray, keep: bool) -> FloatArray:
        """Notes one tick, as a moment if wanted; returns the action that the ego drives."""
        egos = world.egos
        speed = float(egos.speed[self._ego])
        self._blocked.update(speed)
        if keep:
            self._moments.append((len(self._poses), [self._view(world, by) for by in self._displacements(speed)]))
        noise = self._noise
        out = action if noise is None else noise.disturbed(action, speed, observation)
        if noise is not None and noise.stalls and speed < HELD_M_S:
            self._hold(noise, action, speed)
        elif self._waiting:
            self._released |= dict.fromkeys(self._waiting, len(self._poses))
            self._waiting = []
        self._poses.append((*egos.position[self._ego].tolist(), float(egos.heading[self._ego])))
        self._noisy.append(noise is not None and noise.active)
        return out

    def _hold(self, noise: Disturbance, action: FloatArray, speed: float) -> None:
        """Notes what the demonstrator asks for in a tick in which its ego is held."""
        tick = len(self._poses)
        self._held[tick] = intended(action, speed)
        if noise.told_s is None:
            return
        if action[0] >= STARTS:
            self._waiting.append(tick)
        if self._blocked.seconds == TICK_S:
            self._blocked.seconds = noise.told_s

    def moments(self) -> Moments:
        """Moments whose waypoints the expert drove alone, or asked for while held; few of a long standstill."""
        rows, stood = [], 0
        for tick, views in self._moments:
            held, start = self._held.get(tick), self._released.get(tick, tick)
            driven = self._alone(start)
            if held is None and not driven:
                continue
            let_go = driven and start > tick
            held = None if let_go else held
            waypoints = [self._waypoints(start, by) if held is None else held for by, _, _ in views]
            stands = held is not None or np.abs(waypoints[0]).max() < STANDS_M
            stood = stood + 1 if stands else 0
            if let_go or stood % (KEPT_STANDING if held is None else KEPT_HELD) == 0:
                rows.append(([layers for _, layers, _ in views], [numbers for _, _, numbers in views], waypoints))
        return Moments.of(rows)

    def _alone(self, tick: int) -> bool:
        """Whether the expert drives alone from a tick on for as long as waypoints reach."""
        last = tick + _AHEAD[-1]
        return last < len(self._poses) and not any(self._noisy[tick:last])

    def _displacements(self, speed: float) -> Iterator[FloatArray]:
        yield np.zeros(3)
        for _ in range(VIEWS - 1):
            by = drawn_displacement(self._rng)
            yield by if speed >= MOVING_M_S else np.zeros(3)

    def _view(self, world: World, by: FloatArray) -> tuple[FloatArray, np.ndarray, Float32Array]:
        seen = displaced(world, self._ego, by)
        observation = {sensor.name: _read(sensor, seen, self._ego) for sensor in self._sensors}
        return by, packed(observation[SENSOR]), measured(observation, self._blocked.seconds)

    def _waypoints(self, tick: int, by: FloatArray) -> FloatArray:
        """(4, 2) where the ego goes, in the frame of a displaced pose, m."""
        x, y, heading = self._poses[tick]
        cos, sin = np.cos(heading), np.sin(heading)
        x, y, heading = x + by[0] * cos - by[1] * sin, y + by[0] * sin + by[1] * cos, heading + by[2]
        future = np.array([self._poses[tick + ahead][:2] for ahead in _AHEAD]) - (x, y)
        cos, sin = np.cos(heading), np.sin(heading)
        return np.asarray(future @ np.array([[cos, -sin], [sin, cos]]))


def _read(sensor: Sensor, world: World, ego: int) -> np.ndarray:
    return np.asarray(sensor.read(world, ego))
