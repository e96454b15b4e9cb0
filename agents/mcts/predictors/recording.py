"""Recording: the autopilot drives among traffic; the egos' scenes become samples.

Episodes are numbered; network, missions, traffic and seed follow from the number and the dataset's seed alone, so a
interrupted recording resumes, and the same order gives the same bytes.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from dohyo.agents.driving import decisions
from dohyo.agents.experts.autopilot import Autopilot
from dohyo.agents.mcts.predictors.dataset import (
    FUTURE_STEP_S,
    FUTURE_STEPS,
    SCHEMA_VERSION,
    Sample,
    Shard,
    load_shard,
)
from dohyo.agents.planning.scene import SENSORS, Scene, SceneBuilder
from dohyo.agents.shards import claim_folder
from dohyo.evaluation.agent import Agent
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.geometry import wrap_angle
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.seeds import HELD_OUT_FROM
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import World

TRAINING = ("town-train", "adlershof", "braunschweig", "district")
HELD_OUT = ("town-test", "ingolstadt")
VALIDATION_EVERY = 5
ROUTES_M = (250.0, 1500.0)
VEHICLES_PER_KM, MOST_VEHICLES = (2.0, 12.0), 300
ATTEMPTS = 2000
_FUTURE_TICKS = MappingProxyType({j: round((j + 1) * FUTURE_STEP_S / TICK_S) for j in range(FUTURE_STEPS)})
_LAST = _FUTURE_TICKS[FUTURE_STEPS - 1]


@dataclass(frozen=True, slots=True)
class MotionRequest:
    """Order of a recording.

    Attributes:
        networks: Used in turn, one episode each.
        hours: Driving time of all egos together.
        seed: Of all randomness.
        every_s: Time between two samples of one ego.
        egos: Number per episode.
        episode_s: Duration of an episode.
    """

    networks: tuple[str, ...] = TRAINING
    hours: float = 2.0
    seed: int = 0
    every_s: float = 0.5
    egos: int = 6
    episode_s: float = 60.0


def record_motion(order: MotionRequest, out: Path, progress: Callable[[float], None] = lambda hours: None) -> int:
    """Records until there are enough hours; existing episodes are kept.

    Args:
        order: What to record.
        out: Folder; gets dataset.json and train/, validation/, test/ with one shard per episode.
        progress: Called with the hours recorded so far after every episode.

    Returns:
        Number of samples.

    Raises:
        InvalidInputError: Unknown networks, or the folder holds a dataset of another order.
    """
    _claim(order, out)
    hours, samples = order.egos * order.episode_s / 3600.0, 0
    for episode in range(math.ceil(order.hours / hours - 1e-6)):
        network, number = order.networks[episode % len(order.networks)], episode // len(order.networks)
        path = out / split_of(network, number) / f"{network}-{number:04d}.npz"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, record_episode(scenario(order, network, number), order).to_bytes())
        samples += len(load_shard(path))
        progress(min((episode + 1) * hours, order.hours))
    return samples


def split_of(network: str, number: int) -> str:
    """Split of an episode: held-out networks test, of the others every fifth validates."""
    if network in HELD_OUT:
        return "test"
    return "validation" if number % VALIDATION_EVERY == VALIDATION_EVERY - 1 else "train"


def scenario(order: MotionRequest, name: str, number: int) -> Scenario:
    """The scenario of one episode.

    Raises:
        InvalidInputError: No such network, or it has too few missions.
    """
    network = load_network(name)
    rng = np.random.default_rng([order.seed, zlib.crc32(name.encode()), number])
    lanes = network.lanes
    km = float(lanes.length[lanes.drivable & ~lanes.internal].sum()) / 1000.0
    vehicles = min(round(km * rng.uniform(*VEHICLES_PER_KM)), MOST_VEHICLES)
    missions = tuple(_missions(network, order.egos, rng))
    if len(missions) < order.egos:
        raise InvalidInputError(f"network '{name}': expected {order.egos} routes of {ROUTES_M} m, got {len(missions)}")
    return Scenario(
        name=f"motion-{name}-{number}",
        network=name,
        missions=missions,
        traffic=Traffic(vehicles=vehicles, bicycles=vehicles // 8, pedestrians=vehicles // 2, warm_up_s=30.0),
        seed=int(rng.integers(HELD_OUT_FROM)),
    )


def record_episode(scenario: Scenario, order: MotionRequest) -> Shard:
    """Drives one scenario with the autopilot and takes samples."""
    agents: dict[str, Agent] = {mission.name: Autopilot() for mission in scenario.missions}  # type: ignore[abstract]
    sensors = tuple(dict.fromkeys((*SENSORS, *Autopilot.spec.sensors)))
    builders = {name: SceneBuilder() for name in agents}
    stride = max(round(order.every_s / TICK_S), 1)
    moments: list[tuple[int, int, Scene]] = []
    worlds: list[World] = []
    with closing(DrivingEnv(scenario, sensors, Autopilot.spec.control, reward=None)) as env:
        for now in decisions(env, agents, round(order.episode_s / TICK_S)):
            worlds.append(env.world)
            for ego, name in enumerate(agents):
                if name in now.actions:
                    scene = builders[name].update(now.observations[name])
                    if now.tick % stride == 0:
                        moments.append((now.tick, ego, scene))
    tracks = _Tracks(worlds)
    return Shard.of([tracks.sample(*moment) for moment in moments if tracks.whole(*moment[:2])])


class _Tracks:
    """Poses of all actors in an episode."""

    def __init__(self, worlds: list[World]) -> None:
        self._ticks = len(worlds)
        self._poses: dict[int, FloatArray] = {}
        for tick, world in enumerate(worlds):
            egos, actors = world.egos, world.actors
            for ego in np.flatnonzero(egos.active).tolist():
                self._put(-1 - ego, tick, egos.position[ego], egos.heading[ego])
            for row, key in enumerate(actors.key.tolist()):
                self._put(key, tick, actors.position[row], actors.heading[row])

    def _put(self, key: int, tick: int, position: FloatArray, heading: float) -> None:
        if key not in self._poses:
            self._poses[key] = np.full((self._ticks + _LAST + 1, 3), np.nan)
        self._poses[key][tick] = *position, heading

    def whole(self, tick: int, ego: int) -> bool:
        """Whether the ego drives for the whole future."""
        return bool(np.isfinite(self._poses[-1 - ego][tick + _LAST, 0]))

    def sample(self, tick: int, ego: int, scene: Scene) -> Sample:
        """Scene with its future."""
        now = self._poses[-1 - ego][tick]
        rows = tick + np.array(list(_FUTURE_TICKS.values()))
        keys = scene.actors.key.tolist()
        future = np.full((len(keys) + 1, FUTURE_STEPS, 3), np.nan)
        for row, key in enumerate((-1 - ego, *keys)):
            if key in self._poses:
                future[row] = _in_frame(now, self._poses[key][rows])
        valid = np.isfinite(future[:, :, 0])
        future = np.where(valid[:, :, None], future, 0.0).astype(np.float32)
        return Sample(scene, future[0], valid[0], future[1:], valid[1:])


def _in_frame(frame: FloatArray, poses: FloatArray) -> FloatArray:
    """(T, 3) poses of the network frame in that of a pose."""
    cos, sin = math.cos(frame[2]), math.sin(frame[2])
    dx, dy = poses[:, 0] - frame[0], poses[:, 1] - frame[1]
    return np.column_stack([dx * cos + dy * sin, dy * cos - dx * sin, wrap_angle(poses[:, 2] - frame[2])])


def _missions(network: RoadNetwork, count: int, rng: np.random.Generator) -> Iterator[Mission]:
    """Missions from different lanes, without U-turns."""
    lanes, taken = network.lanes, set[int]()
    long = lanes.longer_than(40.0)
    for _ in range(ATTEMPTS):
        a, b = (int(lane) for lane in rng.choice(long, 2, replace=False))
        mission = Mission(
            name=f"ego{len(taken)}",
            start=Place(lane=str(lanes.ids[a]), position_m=round(float(rng.uniform(8.0, lanes.length[a] - 20.0)), 1)),
            goal=Place(lane=str(lanes.ids[b]), position_m=round(float(rng.uniform(15.0, lanes.length[b] - 15.0)), 1)),
        )
        if a in taken:
            continue
        try:
            route = plan_route(network, mission)
        except InvalidInputError:
            continue
        turns_back = any(network.connections.direction[p.connection] == "t" for p in route.passages)
        if turns_back or not ROUTES_M[0] <= route.length <= ROUTES_M[1]:
            continue
        taken.add(a)
        yield mission
        if len(taken) == count:
            return


def _claim(order: MotionRequest, out: Path) -> None:
    """Writes dataset.json, or checks that the existing one is equal."""
    if not order.networks or order.hours <= 0 or order.every_s < TICK_S or order.egos < 1:
        raise InvalidInputError(f"expected networks, hours > 0 and a sample at most every {TICK_S} s, got {order}")
    if order.episode_s < _LAST * TICK_S + order.every_s:
        raise InvalidInputError(f"expected episodes longer than the future of 8 s, got {order.episode_s} s")
    for name in order.networks:
        load_network(name)
    document = {
        "schema": SCHEMA_VERSION,
        "networks": list(order.networks),
        "seed": order.seed,
        "every_s": order.every_s,
        "egos": order.egos,
        "episode_s": order.episode_s,
    }
    claim_folder(out, document)
