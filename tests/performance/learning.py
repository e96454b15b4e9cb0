"""How much of an update is its networks' own work, and of a step the environment's.

    python -m tests.performance learning

Arms alternate in short blocks on one core, and their time is the core's own, so that other processes disturb little.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box, Dict
from stable_baselines3 import SAC
from stable_baselines3.common.logger import Logger
from tensordict import TensorDict, TensorDictBase

from dohyo.agents.learning.algorithms.off_policy import OffPolicyConfig
from dohyo.agents.learning.algorithms.sac import Sac, SacConfig
from dohyo.agents.learning.experience.behaviour import PolicyBehaviour
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.replay import Replay, ReplayConfig
from dohyo.agents.learning.networks.modules import ObservationEncoder
from dohyo.agents.learning.tasks.task import Array, Env, Task, held_out_seeds
from dohyo.agents.perception.augmentation import random_shift
from dohyo.agents.perception.encoders.rlad import RladEncoder
from dohyo.sumo_networks.envs.single_env import SingleDrivingEnv
from tests.performance.world import SENSORS, scenario

VECTOR = Box(-np.inf, np.inf, (11,), np.float32)
STACK, SIDE = 3, 64
PICTURE = Box(0, 255, (3 * STACK, SIDE, SIDE), np.uint8)
ACTION = Box(-1.0, 1.0, (3,), np.float32)
ENTRIES = 2000
CPU = torch.device("cpu")


def medians(arms: Mapping[str, Callable[[], object]], blocks: int, calls: int) -> dict[str, float]:
    """Seconds of the core per call of each arm, the median over blocks that alternate."""
    for arm in arms.values():
        arm()
    times: dict[str, list[float]] = {name: [] for name in arms}
    for _ in range(blocks):
        for name, arm in arms.items():
            began = time.process_time()
            for _ in range(calls):
                arm()
            times[name].append((time.process_time() - began) / calls)
    return {name: statistics.median(values) for name, values in times.items()}


class NoiseEnv(gymnasium.Env[Array, Array]):
    """Observations of noise, for stable-baselines3."""

    observation_space, action_space = VECTOR, ACTION

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        return np.random.default_rng(seed).standard_normal(11, np.float32), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        return np.random.default_rng().standard_normal(11, np.float32), 0.0, False, False, {}


def learner(kind: Any, config: OffPolicyConfig, space: Dict, folder: Path, stack: int = 1, **options: Any) -> Any:
    """A learner whose replay is full of noise."""
    torch.manual_seed(0)
    replay = Replay(folder, (space, ACTION), config.replay, gamma=0.99, slack=0, seed=0, stack=stack)
    rng = np.random.default_rng(0)
    length = 200
    for _ in range(ENTRIES // (length + 1)):
        frames = {
            name: rng.integers(0, 256, (length + 1, 3, SIDE, SIDE), np.uint8)
            if box.dtype == np.uint8
            else rng.standard_normal((length + 1, *(box.shape or ())), np.float32)
            for name, box in space.items()
        }
        actions = rng.uniform(-1.0, 1.0, (length, 3)).astype(np.float32)
        rewards = rng.standard_normal(length, np.float32)
        replay.add_episode(frames, actions, rewards, terminated=False, source=0)
    task = SimpleNamespace(name="noise", observation_space=space, action_space=ACTION)
    return kind(task, SimpleNamespace(steps=10**6), replay, config, CPU, **options)


def update(one: Any, batch: int, augment: Callable[[TensorDictBase], TensorDictBase] = lambda batch: batch) -> None:
    """All of an update: the batch, losses, gradients, optimiser and target."""
    one.learn(augment(one.replay.sample(batch)))


def bare(sac: Sac, batch: TensorDictBase) -> None:
    """The passes of SAC's networks that an update needs, forward and backward, and nothing else."""
    action = batch["action"]
    with torch.no_grad():
        following = sac.encoder(batch["next", "observation"])
        sac.actor(following)
        sac.target(following, action)
    features = sac.encoder(batch["observation"])
    values = sac.critics(features, action)
    mean, log_std = sac.actor(features.detach())
    sac.critics.requires_grad_(False)
    judged = sac.critics(features.detach(), mean)
    sac.critics.requires_grad_(True)
    (values.sum() + judged.sum() + log_std.sum()).backward()  # type: ignore[no-untyped-call]
    for parameter in (*sac.encoder.parameters(), *sac.critics.parameters(), *sac.actor.parameters()):
        parameter.grad = None


def sac_updates() -> dict[str, float]:
    """An update of SAC, 256 x 256, batch 256: its ms, its time to its bare passes', updates to stable-baselines3's."""
    torch.set_num_threads(1)
    config = SacConfig(replay=ReplayConfig(capacity=ENTRIES))
    peer = SAC("MlpPolicy", NoiseEnv(), buffer_size=ENTRIES, learning_starts=ENTRIES, device="cpu")
    peer.set_logger(Logger(None, []))
    peer.learn(ENTRIES // 2)
    with tempfile.TemporaryDirectory() as folder:
        ours = learner(Sac, config, Dict({"observation": VECTOR}), Path(folder))
        whole, passes = partial(update, ours, 256), partial(bare, ours, ours.replay.sample(256))
        own = medians({"ours": whole, "bare": passes}, blocks=15, calls=20)
        both = medians({"ours": whole, "peer": partial(peer.train, 1, 256)}, blocks=15, calls=20)
    return {"ms": 1e3 * own["ours"], "to_bare": own["ours"] / own["bare"], "to_peer": both["peer"] / both["ours"]}


def pixel_updates(batch: int = 64) -> dict[str, float]:
    """A DrQ-like update: SAC on stacks of three shifted pictures, with RLAD's encoder; ms, and time to bare passes'."""
    torch.set_num_threads(1)
    space, generator = Dict({"camera": PICTURE}), torch.Generator().manual_seed(0)

    def shifted(drawn: TensorDictBase) -> TensorDictBase:
        for seen in (drawn["observation"], drawn["next", "observation"]):
            seen["camera"] = random_shift(seen["camera"], generator, pad=4)
        return drawn

    with tempfile.TemporaryDirectory() as folder:
        config = SacConfig(replay=ReplayConfig(capacity=ENTRIES))
        encoder = ObservationEncoder(space, {"camera": RladEncoder((3 * STACK, SIDE, SIDE), features=50)})
        ours = learner(Sac, config, space, Path(folder), STACK, encoder=encoder)
        drawn = ours.replay.sample(batch)
        arms = {"ours": partial(update, ours, batch, shifted), "bare": partial(bare, ours, drawn)}
        times = medians(arms, blocks=7, calls=2)
    return {"ms": 1e3 * times["ours"], "to_bare": times["ours"] / times["bare"]}


def pixel_bytes() -> float:
    """Bytes on the disk per stored transition of stacked pictures of 64 x 64, in units of one frame."""
    with tempfile.TemporaryDirectory() as folder:
        path, space = Path(folder) / "replay", Dict({"camera": PICTURE})
        config = ReplayConfig(capacity=ENTRIES)
        replay = Replay(path, (space, ACTION), config, gamma=0.99, slack=0, seed=0, stack=STACK)
        frames = {"camera": np.zeros((2, 3, SIDE, SIDE), np.uint8)}
        replay.add_episode(frames, np.zeros((1, 3)), np.zeros(1), terminated=False, source=0)
        stored = sum(file.stat().st_size for file in path.rglob("*.memmap"))
    return stored / ENTRIES / (3 * SIDE * SIDE)


@dataclass(frozen=True)
class Drive(Task):
    """One ego in Ingolstadt, among 50 vehicles."""

    name = "drive"
    held_out = held_out_seeds(1)

    @property
    def observation_space(self) -> Dict:
        env = self.make_env(0)
        space: Any = env.observation_space
        return Dict(space.spaces)

    @property
    def action_space(self) -> Box:
        space: Any = self.make_env(0).action_space
        return Box(space.low.astype(np.float32), space.high.astype(np.float32), dtype=np.float32)

    def make_env(self, rank: int) -> Env:
        return SingleDrivingEnv(scenario("ingolstadt", 50), sensors=SENSORS, control="lane_command")


def collector_overhead(blocks: int = 15) -> dict[str, float]:
    """A step of one ego in SUMO by the collector: its ms, and its time to that of the environment alone."""
    torch.set_num_threads(1)
    task = Drive()
    environments = task.make_environments(1, processes=False)
    action = np.tile(np.float32((5.0, 0.0)), (1, 1))
    behaviour = PolicyBehaviour(lambda observation: TensorDict({"action": torch.from_numpy(action)}, [1]))
    collector = Collector(environments, task, seed=0)
    collector.begin()
    arms = {"ours": partial(collector.step, behaviour), "bare": partial(environments.step, action)}
    try:
        times = medians(arms, blocks, calls=5)
    finally:
        environments.close()
    return {"ms": 1e3 * times["ours"], "to_bare": times["ours"] / times["bare"]}
