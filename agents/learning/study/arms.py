"""Arms of the study of peers: each algorithm on some environments, with the settings of both libraries.

Settings are the libraries' defaults, or those of RL Zoo, in both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from dohyo.agents.learning.algorithms.ddpg import DdpgConfig
from dohyo.agents.learning.algorithms.iqn import IqnConfig
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig
from dohyo.agents.learning.algorithms.sac import SacConfig
from dohyo.agents.learning.experience.replay import ReplayConfig


@dataclass(frozen=True)
class Match:
    """One algorithm on one environment, in both libraries.

    Attributes:
        env: Name in gymnasium's registry.
        algorithm: Ours.
        peer: Class of stable-baselines3.
        steps: Of the environments together.
        config: Our settings.
        settings: The peer's settings.
        rows: Environments that step together.
        noise: Standard deviation of the peer's action noise, in [-1, 1]; None: it has none.
        trainings: Of each library; more where three do not decide.
    """

    env: str
    algorithm: str
    peer: str
    steps: int
    config: Any
    settings: Mapping[str, Any] = field(default_factory=dict)
    rows: int = 1
    noise: float | None = None
    trainings: int = 3


def _continuous(env: str, steps: int, ppo_steps: int, ddpg_trainings: int = 3) -> tuple[Match, ...]:
    replay = ReplayConfig(capacity=200_000)
    sized = {"buffer_size": 200_000}
    ppo = PpoConfig(  # RL Zoo: Pendulum-v1, without its state-dependent exploration
        horizon=1024,
        learning_rate=1e-3,
        learning_rate_decay=1.0,
        epochs=10,
        batch=64,
        gamma=0.9 if env == "Pendulum-v1" else 0.99,
        entropy=0.0,
        value_scale=0.5,
        hidden=(64, 64),
    )
    theirs = {"n_steps": 1024, "learning_rate": 1e-3, "gamma": ppo.gamma, "ent_coef": 0.0}
    return (
        Match(env, "sac", "SAC", steps, SacConfig(replay=replay), sized),
        Match(env, "ddpg", "DDPG", steps, DdpgConfig(replay=replay), sized, noise=0.1, trainings=ddpg_trainings),
        Match(env, "ppo", "PPO", ppo_steps, ppo, theirs, rows=4),
    )


_IQN = IqnConfig(  # RL Zoo: CartPole-v1
    replay=ReplayConfig(capacity=100_000),
    learning_rate=2.3e-3,
    batch=64,
    learning_starts=1000,
    updates_per_step=0.5,
    target_every=128,
    exploration_steps=8000,
    last_exploration=0.04,
    hidden=(256, 256),
)
_DQN = {
    "buffer_size": 100_000,
    "learning_rate": 2.3e-3,
    "batch_size": 64,
    "learning_starts": 1000,
    "train_freq": 256,
    "gradient_steps": 128,
    "target_update_interval": 10,
    "exploration_fraction": 0.16,
    "exploration_final_eps": 0.04,
    "policy_kwargs": {"net_arch": [256, 256]},
}
_ALL = (
    Match("CartPole-v1", "iqn", "DQN", 50_000, _IQN, _DQN),
    *_continuous("Pendulum-v1", 10_000, 100_000),
    *_continuous("Hopper-v5", 100_000, 100_000, ddpg_trainings=5),
    *_continuous("HalfCheetah-v5", 100_000, 100_000),
)
MATCHES: Mapping[tuple[str, str], Match] = MappingProxyType({(one.env, one.algorithm): one for one in _ALL})
