"""Our algorithms against stable-baselines3's: the same environments, steps, settings and held-out episodes.

    python -m dohyo.agents.learning.peers [--only Pendulum-v1,CartPole-v1] [--out FOLDER]

Every training adds a row to FOLDER/peers.csv; one that is there is not trained again. Updates are counted per second of
the core that a training took, with the environment's steps, so that other processes disturb little. Hopper-v5 needs the
package mujoco. Settings are the libraries' defaults, or where a name is given those of RL Zoo, in both.
"""

from __future__ import annotations

import argparse
import csv
import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from dohyo.agents.learning.collector import Collector
from dohyo.agents.learning.config import PpoConfig
from dohyo.agents.learning.ddpg import DdpgConfig
from dohyo.agents.learning.evaluation import evaluate
from dohyo.agents.learning.gymnasium_task import OFF_POLICY, GymnasiumTask
from dohyo.agents.learning.iqn import IqnConfig
from dohyo.agents.learning.ppo import Ppo
from dohyo.agents.learning.replay import Replay, ReplayConfig
from dohyo.agents.learning.sac import SacConfig
from dohyo.agents.learning.task import Array, named
from dohyo.evaluation.statistics import mean_estimate
from dohyo.sumo_networks.errors import InvalidInputError

COLUMNS = ("env", "algorithm", "library", "seed", "steps", "return", "updates", "core_s")
SEEDS, EPISODES = (0, 1, 2), 20
OUT = Path("runs/peers")


@dataclass(frozen=True)
class Arm:
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


def _continuous(env: str, steps: int, ppo_steps: int) -> tuple[Arm, ...]:
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
        Arm(env, "sac", "SAC", steps, SacConfig(replay=replay), sized),
        Arm(env, "ddpg", "DDPG", steps, DdpgConfig(replay=replay), sized, noise=0.1),
        Arm(env, "ppo", "PPO", ppo_steps, ppo, theirs, rows=4),
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
CARTPOLE = Arm("CartPole-v1", "iqn", "DQN", 50_000, _IQN, _DQN)
ARMS = (CARTPOLE, *_continuous("Pendulum-v1", 10_000, 100_000), *_continuous("Hopper-v5", 100_000, 100_000))


def train_ours(arm: Arm, seed: int) -> tuple[Callable[[TensorDict], Array], int]:
    """A policy that our algorithm learned, and its gradient steps."""
    torch.manual_seed(seed)
    task = GymnasiumTask(arm.env, EPISODES)
    environments = task.make_environments(arm.rows, processes=False)
    collector = Collector(environments, task, seed)
    with tempfile.TemporaryDirectory() as folder:
        learner: Any
        if arm.algorithm == "ppo":
            learner = Ppo(task, collector, arm.config, torch.device("cpu"), seed)
        else:
            spaces, config = (named(task.observation_space), task.action_space), arm.config
            replay = Replay(Path(folder), spaces, config.replay, gamma=config.gamma, slack=0, seed=seed)
            learner = OFF_POLICY[arm.algorithm](task, collector, replay, config, torch.device("cpu"))
        learner.begin()
        while collector.steps < arm.steps:
            learner.round()
    environments.close()
    return learner.act, learner.updates


def train_peer(arm: Arm, seed: int) -> tuple[Callable[[TensorDict], Array], int]:
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
    environments = make_vec_env(arm.env, arm.rows, seed=seed)
    settings = dict(arm.settings)
    if arm.noise is not None:
        size = environments.action_space.shape
        settings["action_noise"] = NormalActionNoise(np.zeros(size or 1), np.full(size or 1, arm.noise))
    kind = getattr(stable_baselines3, arm.peer)
    model: Any = kind("MlpPolicy", environments, seed=seed, device="cpu", **settings)
    model.learn(arm.steps)
    environments.close()
    updates = model._n_updates
    if arm.peer == "PPO":  # which counts epochs
        updates *= arm.rows * model.n_steps // model.batch_size

    def act(observation: TensorDict) -> Array:
        actions: Array = model.predict(observation["observation"].numpy(), deterministic=True)[0]
        return actions

    return act, updates


LIBRARIES = {"dohyo": train_ours, "stable-baselines3": train_peer}


def row(arm: Arm, library: str, seed: int) -> dict[str, Any]:
    """Trains and judges."""
    began = time.process_time()
    act, updates = LIBRARIES[library](arm, seed)
    core_s = time.process_time() - began
    task = GymnasiumTask(arm.env, EPISODES)
    environments = task.make_environments(EPISODES, processes=False)
    value = evaluate(task, environments, act).mean_return.mean
    environments.close()
    facts = (arm.env, arm.algorithm, library, seed, arm.steps, value, updates, round(core_s, 2))
    return dict(zip(COLUMNS, facts, strict=True))


def stored(path: Path) -> list[dict[str, str]]:
    """Rows of finished trainings."""
    if not path.exists():
        return []
    with path.open() as file:
        return list(csv.DictReader(file))


def table(rows: Sequence[Mapping[str, str]]) -> str:
    """Returns with 95 % intervals over the seeds, and updates per second of the core, as Markdown."""
    lines = ["| environment | algorithm | library | seeds | return | updates/s |", "|---|---|---|---|---|---|"]
    for key in dict.fromkeys((one["env"], one["algorithm"], one["library"]) for one in rows):
        mine = [one for one in rows if (one["env"], one["algorithm"], one["library"]) == key]
        value = mean_estimate([float(one["return"]) for one in mine])
        rate = sum(float(one["updates"]) for one in mine) / sum(float(one["core_s"]) for one in mine)
        shown = f"{value.mean:.1f} [{value.low:.1f}, {value.high:.1f}]"
        lines.append(f"| {' | '.join(key)} | {len(mine)} | {shown} | {rate:.0f} |")
    return "\n".join(lines)


def main() -> None:
    """Trains what is missing, and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", help="environments, separated by commas")
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    torch.set_num_threads(1)
    path = arguments.out / "peers.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    chosen = [arm for arm in ARMS if arguments.only is None or arm.env in arguments.only.split(",")]
    known = {(one["env"], one["algorithm"], one["library"], int(one["seed"])) for one in stored(path)}
    for seed, arm, library in ((seed, arm, library) for seed in SEEDS for arm in chosen for library in LIBRARIES):
        if (arm.env, arm.algorithm, library, seed) not in known:
            finished = row(arm, library, seed)
            with path.open("a", newline="") as file:
                writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
                if not file.tell():
                    writer.writeheader()
                writer.writerow(finished)
    print(table(stored(path)))


if __name__ == "__main__":
    main()
