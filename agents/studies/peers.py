"""Study `peers`: our algorithms against stable-baselines3's, with equal steps, settings and held-out episodes.

    python -m dohyo.agents.studies peers run --only Pendulum-v1 CartPole-v1
    python -m dohyo.agents.studies peers table --rows out/studies/peers

Updates are counted per second of the core that a training took, with the environment's steps, so that other processes
disturb little. Settings are the libraries' defaults, or those of RL Zoo, in both.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from dohyo.agents.learning.algorithms.ddpg import DdpgConfig
from dohyo.agents.learning.algorithms.iqn import IqnConfig
from dohyo.agents.learning.algorithms.ppo import Ppo
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig
from dohyo.agents.learning.algorithms.sac import SacConfig
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.replay import Replay, ReplayConfig
from dohyo.agents.learning.gymnasium.task import OFF_POLICY, GymnasiumTask
from dohyo.agents.learning.runs.evaluation import evaluate
from dohyo.agents.learning.tasks.task import Array, named
from dohyo.agents.studies.arms import Block, Cell, Place, cells_of
from dohyo.agents.studies.rows import Row, is_lost
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Results, Study
from dohyo.agents.studies.tables import fixed
from dohyo.evaluation.report.style import markdown
from dohyo.evaluation.statistics import mean_estimate
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError

TRAININGS = (0, 1, 2)
HERE = Path(__file__).parents[1] / "learning"


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
    """

    env: str
    algorithm: str
    peer: str
    steps: int
    config: Any
    settings: Mapping[str, Any] = field(default_factory=dict)
    rows: int = 1
    noise: float | None = None


def _continuous(env: str, steps: int, ppo_steps: int) -> tuple[Match, ...]:
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
        Match(env, "ddpg", "DDPG", steps, DdpgConfig(replay=replay), sized, noise=0.1),
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
CARTPOLE = Match("CartPole-v1", "iqn", "DQN", 50_000, _IQN, _DQN)
MATCHES = (CARTPOLE, *_continuous("Pendulum-v1", 10_000, 100_000), *_continuous("Hopper-v5", 100_000, 100_000))


def _match(env: str, algorithm: str) -> Match:
    (match,) = [one for one in MATCHES if (one.env, one.algorithm) == (env, algorithm)]
    return match


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


class Options(Config):
    """Options of a run.

    Attributes:
        episodes: Held-out episodes of every policy.
    """

    episodes: int = 20


def cells(options: Options) -> list[Cell]:
    """Every algorithm of both libraries on its environments, three trainings each."""
    blocks = []
    for match in MATCHES:
        arms = [f"{match.algorithm}, {library}" for library in LIBRARIES]
        blocks.append(Block(arms, TRAININGS, [Place(match.env, "held-out", None)]))
    return cells_of(blocks)


def work(options: Options, job: Job) -> Iterator[Row]:
    """Trains and judges."""
    torch.set_num_threads(1)
    for cell in job:
        algorithm, library = cell.arm.split(", ")
        match = _match(cell.benchmark, algorithm)
        began = time.process_time()
        act, updates = LIBRARIES[library](match, cell.training_seed or 0)
        core_s = time.process_time() - began
        task = GymnasiumTask(match.env, options.episodes)
        environments = task.make_environments(options.episodes, processes=False)
        value = evaluate(task, environments, act).mean_return.mean
        environments.close()
        measures = {"steps": match.steps, "return": value, "updates": updates, "core_s": round(core_s, 2)}
        yield cell._asdict() | measures


def table(results: Results) -> str:
    """Returns with intervals over the trainings, and updates per second of the core."""
    rows = [row for row in results.rows if not is_lost(row)]
    lines = []
    for env, arm in sorted({(row["benchmark"], row["arm"]) for row in rows}):
        mine = [row for row in rows if (row["benchmark"], row["arm"]) == (env, arm)]
        value = mean_estimate([float(row["return"]) for row in mine])
        rate = sum(row["updates"] for row in mine) / sum(row["core_s"] for row in mine)
        algorithm, library = arm.split(", ")
        name = algorithm.upper() if library == "dohyo" else _match(env, algorithm).peer
        lines.append([env, name, library, f"{mine[0]['steps']:,}", str(len(mine)), fixed(value), f"{rate:.0f}"])
    heads = ["environment", "algorithm", "library", "steps", "trainings", "return", "updates/s"]
    return markdown(heads, lines) if lines else ""


STUDY = Study(
    summary="our algorithms against stable-baselines3's on gymnasium's environments",
    room=HERE,
    published="peers",
    options=Options,
    cells=cells,
    work=work,
    tables={"peers": table},
)
