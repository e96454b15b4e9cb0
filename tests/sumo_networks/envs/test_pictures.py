from __future__ import annotations

import numpy as np
import pytest
import torch

from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.envs.torchrl_env import make_torchrl_env
from dohyo.sumo_networks.envs.vector_env import VectorDrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.sensors import BirdseyeConfig, CameraConfig, Track, make_sensors
from tests.sumo_networks.simulation.drives import busy_road

NAMES = ("speedometer", "camera_semantic", "camera_depth", "birdseye_rgb")


def test_pictures_keep_their_dtype_in_every_environment(make_env: object) -> None:
    scenario = busy_road()
    env: DrivingEnv = make_env(scenario, sensors=NAMES, reward=None)  # type: ignore[operator]
    observations, _ = env.reset()
    assert env.observation_space("ego").contains(observations["ego"])
    expected = {name: array.dtype for name, array in observations["ego"].items()}
    first = {name: array.copy() for name, array in observations["ego"].items()}
    env.close()
    assert expected["camera_semantic"] == np.uint8
    assert expected["camera_depth"] == np.float32
    vector = VectorDrivingEnv([scenario], 1, sensors=NAMES, reward=None)
    try:
        batch, _ = vector.reset(seed=scenario.seed)
        assert {name: array.dtype for name, array in batch.items()} == expected
        assert vector.observation_space.contains(batch)
        assert all(batch[name].shape[1:] == first[name].shape for name in NAMES)
    finally:
        vector.close()


def test_torchrl_gets_bytes() -> None:
    env = make_torchrl_env([busy_road()], 1, sensors=("camera_semantic",))
    try:
        start = env.reset()
        assert start["camera_semantic"].dtype == torch.uint8
        assert env.observation_spec["camera_semantic"].dtype == torch.uint8
    finally:
        env.close()


def test_an_environment_takes_cameras_of_ones_own(make_env: object) -> None:
    mine = (CameraConfig(name="tiny", width=32, height=16), BirdseyeConfig(name="map", width=16, height=16))
    env: DrivingEnv = make_env(busy_road(), sensors=mine, reward=None)  # type: ignore[operator]
    observations, _ = env.reset()
    assert {name: array.shape for name, array in observations["ego"].items()} == {
        "tiny": (3, 16, 32),
        "map": (14, 16, 16),
    }
    with pytest.raises(InvalidInputError, match="'map' needs track 'privileged'"):
        make_sensors(mine, Track.SENSORS)
