"""Recording: a disturbed autopilot drives, and two cameras on each ego take pictures.

One camera is mounted as the sensor `camera_semantic` is, the other a little off it. The autopilot's pedal and steering
are disturbed, so that there are pictures from beside the lane's middle, and of ways back to it.

Network, missions, traffic, conditions and seed of an episode follow from its number and the dataset's seed alone, so a
interrupted recording resumes, and the same order gives the same bytes.

Source: Albilani 2023, section 6.2.2: pictures of 160 x 80, the camera's pose perturbed, noise in [-0.1, 0.1] on
steering and throttle. The camera's displacement, and the duration of a disturbance, are ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from dohyo.agents.driving import decisions
from dohyo.agents.experts.autopilot import Autopilot
from dohyo.agents.hierarchical.state.nearby import distances
from dohyo.agents.hierarchical.vision.classes import HEIGHT, WIDTH
from dohyo.agents.hierarchical.vision.dataset import SCHEMA_VERSION, Pictures, load_shard
from dohyo.agents.mcts.predictors import recording as motion
from dohyo.agents.shards import claim_folder
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.conditions import TRAIN, conditions_named
from dohyo.sumo_networks.ego.control import AccelerationSteering
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.sensors import CameraConfig, Observation, Sensor
from dohyo.sumo_networks.units import TICK_S

TRAINING, HELD_OUT = "town-train", "town-test"
CAMERA = CameraConfig(name="camera_semantic", mode="semantic", width=WIDTH, height=HEIGHT)
OFF = {"x_m": 0.3, "y_m": 0.5, "z_m": 0.2, "yaw_deg": 5.0, "pitch_deg": 2.0, "roll_deg": 2.0}
"""Largest displacement of a camera."""
NOISE, NOISE_HOLDS_S = 0.1, 0.5
JAYWALKERS = 0.2
VALIDATION_SHARE, TEST_SHARE = 0.25, 0.15


@dataclass(frozen=True, slots=True)
class PictureRequest:
    """Order of a recording.

    Attributes:
        images: For training, at least; a quarter as many more for validation, a seventh from the held-out town.
        seed: Of all randomness.
        egos: Number per episode; each has two cameras.
        every_s: Between two pictures of one camera.
        episode_s: How long an episode lasts.
    """

    images: int = 14_000
    seed: int = 0
    egos: int = 8
    every_s: float = 1.0
    episode_s: float = 45.0

    @property
    def per_episode(self) -> int:
        """Pictures of an episode in which no ego arrives early."""
        return 2 * self.egos * math.ceil(self.episode_s / self.every_s - 1e-6)

    def episodes(self) -> Iterator[tuple[str, str, int]]:
        """Split, network and number of each episode."""
        train = math.ceil(self.images / self.per_episode)
        for number in range(train):
            yield "train", TRAINING, number
        for number in range(math.ceil(train * VALIDATION_SHARE)):
            yield "validation", TRAINING, train + number
        for number in range(math.ceil(train * TEST_SHARE)):
            yield "test", HELD_OUT, number


def record_pictures(order: PictureRequest, out: Path, progress: Callable[[float], None] = lambda share: None) -> int:
    """Records until there are enough pictures; existing episodes are kept.

    Args:
        order: What to record.
        out: Folder; gets dataset.json and train/, validation/, test/ with one shard per episode.
        progress: Called with the share of episodes done, after every episode.

    Returns:
        Number of pictures.

    Raises:
        InvalidInputError: The order is impossible, or the folder holds a dataset of another order.
    """
    _claim(order, out)
    episodes, pictures = list(order.episodes()), 0
    for done, (split, network, number) in enumerate(episodes, start=1):
        path = out / split / f"{network}-{number:04d}.npz"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, record_episode(scenario(order, network, number), order).to_bytes())
        pictures += len(load_shard(path))
        progress(done / len(episodes))
    return pictures


def scenario(order: PictureRequest, name: str, number: int) -> Scenario:
    """The scenario of one episode: missions and traffic as in the motion dataset, with some jaywalkers.

    Raises:
        InvalidInputError: The network has too few missions.
    """
    drawn = motion.scenario(motion.MotionRequest(seed=order.seed, egos=order.egos), name, number)
    conditions = np.random.default_rng(drawn.seed).choice(sorted(TRAIN))
    traffic = drawn.traffic.model_copy(update={"jaywalkers": JAYWALKERS})
    update = {"name": f"semantic-{name}-{number}", "traffic": traffic, "conditions": str(conditions)}
    return drawn.model_copy(update=update)


def record_episode(scenario: Scenario, order: PictureRequest) -> Pictures:
    """Drives one scenario and takes pictures."""
    rng = np.random.default_rng([scenario.seed, SCHEMA_VERSION])
    conditions, names = conditions_named(scenario.conditions), [mission.name for mission in scenario.missions]
    agents = {name: Autopilot() for name in names}  # type: ignore[abstract]
    cameras = {name: [_camera(off, conditions, rng) for off in (np.zeros(6), drawn_off(rng))] for name in names}
    noise = {name: Disturbance(rng.spawn(1)[0]) for name in names}
    stride, rows = max(round(order.every_s / TICK_S), 1), []
    with closing(DrivingEnv(scenario, Autopilot.spec.sensors, Autopilot.spec.control, reward=None)) as env:
        for now in decisions(env, agents, round(order.episode_s / TICK_S)):
            if now.tick % stride == 0:
                for name in now.actions:
                    rows += [(camera.read(env.world, names.index(name))[0], *labels(now.observations[name]), off)
                             for camera, off in cameras[name]]  # fmt: skip
            now.actions.update({name: noise[name].disturbed(action) for name, action in now.actions.items()})
    return Pictures.of(rows)


def labels(observation: Observation) -> tuple[float, float, int]:
    """Distances to impact and to the next event [m], and the next junction's signal."""
    impact, event = distances(observation).tolist()
    return impact, event, int(observation["junctions_ahead"][0, 2])


def drawn_off(rng: np.random.Generator) -> FloatArray:
    """(6,) displacement of a camera: x, y, z [m], yaw, pitch, roll [deg], each uniform within `OFF`."""
    return np.asarray(rng.uniform(-1.0, 1.0, len(OFF)) * np.array(list(OFF.values())))


class Disturbance:
    """Noise on the pedal and the steering, each uniform in [-0.1, 0.1] of full, drawn every 0.5 s."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng, self._ticks = rng, 0
        self._noise = np.zeros(2)
        self._full = AccelerationSteering.space.high.astype(np.float64)

    def disturbed(self, action: FloatArray) -> FloatArray:
        """Disturbed acceleration and steering."""
        if self._ticks % round(NOISE_HOLDS_S / TICK_S) == 0:
            self._noise = self._rng.uniform(-NOISE, NOISE, 2)
        self._ticks += 1
        # No creeping while it should stand: obeyed lights must be recorded.
        noise = self._noise * (action[0] > -1.0, 1.0)
        return np.asarray(action + noise * self._full)


def _camera(off: FloatArray, conditions: object, rng: np.random.Generator) -> tuple[Sensor, FloatArray]:
    moved = {name: getattr(CAMERA, name) + value for name, value in zip(OFF, off.tolist(), strict=True)}
    return CAMERA.model_copy(update=moved).make(conditions, rng), off  # type: ignore[arg-type]


def _claim(order: PictureRequest, out: Path) -> None:
    """Writes dataset.json, or checks that the existing one is equal except for the number of pictures."""
    if order.images < 1 or order.egos < 1 or order.every_s < TICK_S or order.episode_s < order.every_s:
        raise InvalidInputError(
            f"expected images, egos, a picture at most every {TICK_S} s and episodes that last as long, got {order}"
        )
    for name in (TRAINING, HELD_OUT):
        load_network(name)
    document = {"schema": SCHEMA_VERSION, **asdict(order)}
    claim_folder(out, document)
