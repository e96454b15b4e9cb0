"""Trainings of one match in both libraries."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from dohyo.agents.learning.algorithms.ppo import Ppo
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.replay import Replay
from dohyo.agents.learning.gymnasium.task import OFF_POLICY, GymnasiumTask
from dohyo.agents.learning.study.arms import Match
from dohyo.agents.learning.tasks.task import Array, named
from dohyo.sumo_networks.errors import InvalidInputError


def train_ours(match: Match, seed: int) -> tuple[Callable[[TensorDict], Array], int]:
    """A policy that our algorithm learned, and its gradient steps."""
    torch.manual_seed(seed)
    task = GymnasiumTask(match.env)
    environments = task.make_environments(match.rows, processes=False)
    collector = Collector(environments, task, seed)
    with tempfile.TemporaryDirectory() as folder:
        learner: Any
        if match.algorithm == "ppo":
            learner = Ppo(task, collector, match.config, torch.device("cpu"), seed)
        else:
            spaces, config = (named(task.observation_space), task.action_space), match.config
            replay = Replay(Path(folder), spaces, config.replay, gamma=config.gamma, slack=0, seed=seed)
            learner = OFF_POLICY[match.algorithm](task, collector, replay, config, torch.device("cpu"))
        learner.begin()
        while collector.steps < match.steps:
            learner.round()
    environments.close()
    return learner.act, learner.updates


def train_peer(match: Match, seed: int) -> tuple[Callable[[TensorDict], Array], int]:
    """A policy that stable-baselines3's algorithm learned, and its gradient steps.

    Raises:
        InvalidInputError: It is not installed.
    """
    try:
        import stable_baselines3
        from stable_baselines3.common.env_util import make_vec_env
        from stable_baselines3.common.noise import NormalActionNoise
    except ImportError as error:
        raise InvalidInputError("expected stable-baselines3, which make setup installs") from error
    environments = make_vec_env(match.env, match.rows, seed=seed)
    settings = dict(match.settings)
    if match.noise is not None:
        size = environments.action_space.shape
        settings["action_noise"] = NormalActionNoise(np.zeros(size or 1), np.full(size or 1, match.noise))
    kind = getattr(stable_baselines3, match.peer)
    model: Any = kind("MlpPolicy", environments, seed=seed, device="cpu", **settings)
    model.learn(match.steps)
    environments.close()
    updates = model._n_updates
    if match.peer == "PPO":  # which counts epochs
        updates *= match.rows * model.n_steps // model.batch_size

    def act(observation: TensorDict) -> Array:
        actions: Array = model.predict(observation["observation"].numpy(), deterministic=True)[0]
        return actions

    return act, updates


LIBRARIES = {"dohyo": train_ours, "stable-baselines3": train_peer}
