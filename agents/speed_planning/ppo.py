"""Proximal policy optimisation (Schulman et al. 2017) on environments that step many copies at once, with torchrl.

Episodes of all copies begin and end together, at a horizon that truncates them.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.envs.utils import ExplorationType, set_exploration_type
from torchrl.modules import NormalParamExtractor, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value.functional import generalized_advantage_estimate

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError


class CopiedEnv(Protocol):
    """R copies of one environment, advanced together."""

    @property
    def observations(self) -> int:
        """Numbers in one observation, O."""

    @property
    def actions(self) -> int:
        """Numbers in one action, A."""

    def reset(self) -> FloatArray:
        """Begins a new episode in every copy; (R, O)."""

    def step(self, action: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
        """(R, A) actions in [-1, 1] -> (R, O) observations, (R,) rewards, whether the episodes are over."""


@dataclass(frozen=True, slots=True)
class PpoConfig:
    """Settings.

    Attributes:
        iterations: Rounds of one episode in every copy, then learning.
        hidden: Width of each hidden layer of actor and critic.
        learning_rate: Of Adam, falling linearly to a tenth.
        epochs: Passes over a round.
        batch: Transitions per gradient step.
        gamma: Discount per step.
        lambda_: Lambda of the generalised advantage.
        clip: Bound of the probability ratio.
        entropy: Weight of the entropy bonus.
        spread: Standard deviation of the action at the start, before tanh.
    """

    iterations: int = 100
    hidden: tuple[int, ...] = (64, 64)
    learning_rate: float = 3e-4
    epochs: int = 10
    batch: int = 1024
    gamma: float = 0.99
    lambda_: float = 0.95
    clip: float = 0.2
    entropy: float = 1e-3
    spread: float = 0.5


class Actor(nn.Module):
    """Shipped policy: observation -> action in [-1, 1], without randomness."""

    def __init__(self, observations: int, actions: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.body = _layers(observations, hidden, 2 * actions)
        self.actions = actions
        self.sizes = (observations, *hidden, actions)

    def forward(self, observation: Tensor) -> Tensor:
        """(..., O) -> (..., A)."""
        return torch.tanh(self.body(observation)[..., : self.actions])

    def act(self, observation: FloatArray) -> FloatArray:
        """Action of an array."""
        with torch.no_grad():
            return np.asarray(self(torch.as_tensor(observation, dtype=torch.float32)).numpy(), dtype=np.float64)

    def save(self, path: Path) -> None:
        """Writes weights and sizes as safetensors."""
        save_file(self.state_dict(), path, metadata={"sizes": json.dumps(self.sizes)})

    @classmethod
    def load(cls, path: Path) -> Actor:
        """Reads a file of `save`.

        Raises:
            InvalidInputError: The file is missing, or holds no policy.
        """
        try:
            with safe_open(path, framework="pt") as file:
                sizes = json.loads(file.metadata()["sizes"])
            actor = cls(sizes[0], sizes[-1], tuple(sizes[1:-1]))
            actor.load_state_dict(load_file(path))
        except (OSError, SafetensorError, KeyError, TypeError, ValueError, RuntimeError) as error:
            raise InvalidInputError(f"'{path}': expected the weights of a policy, got {error}") from error
        return actor.eval()


def train(
    env: CopiedEnv, config: PpoConfig, seed: int, report: Callable[[int, float], None] = lambda at, reward: None
) -> tuple[Actor, list[float]]:
    """Learns a policy.

    Args:
        env: Draws its own episodes.
        config: Settings.
        seed: Of weights, exploration and batches.
        report: Called with each iteration and its mean reward per step.

    Returns:
        The policy without exploration, and the mean reward per step of each iteration.
    """
    torch.manual_seed(seed)
    actor = Actor(env.observations, env.actions, config.hidden)
    policy = _stochastic(actor, config.spread)
    critic = ValueOperator(_layers(env.observations, config.hidden, 1), in_keys=["observation"])
    loss = ClipPPOLoss(policy, critic, clip_epsilon=config.clip, entropy_coeff=config.entropy, normalize_advantage=True)
    optimizer = torch.optim.Adam(loss.parameters(), lr=config.learning_rate)
    curve = []
    for iteration in range(config.iterations):
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * (1 - 0.9 * iteration / config.iterations)
        round_ = _collect(env, policy)
        curve.append(float(round_["reward"].mean()))
        report(iteration, curve[-1])
        _learn(_with_advantage(round_, critic, config), loss, optimizer, config)
    return actor.eval(), curve


def as_json(config: PpoConfig, seed: int, curve: list[float]) -> str:
    """Facts of a training, for the file beside its checkpoint."""
    return json.dumps({"config": asdict(config), "seed": seed, "mean_reward_per_step": curve}, indent=1)


def _layers(inputs: int, hidden: tuple[int, ...], outputs: int) -> nn.Sequential:
    sizes = (inputs, *hidden)
    layers: list[nn.Module] = []
    for before, after in pairwise(sizes):
        layers += [nn.Linear(before, after), nn.Tanh()]
    last = nn.Linear(sizes[-1], outputs)
    nn.init.orthogonal_(last.weight, 0.1)
    nn.init.zeros_(last.bias)
    return nn.Sequential(*layers, last)


def _stochastic(actor: Actor, spread: float) -> ProbabilisticActor:
    with torch.no_grad():
        last = actor.body[-1]
        assert isinstance(last, nn.Linear)
        last.bias[actor.actions :] = float(np.log(np.expm1(spread)))
    extractor = NormalParamExtractor(scale_mapping="softplus", scale_lb=0.02)
    module = TensorDictModule(nn.Sequential(actor.body, extractor), in_keys=["observation"], out_keys=["loc", "scale"])
    return ProbabilisticActor(
        module,
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        # tanh_loc would apply tanh to the mean twice: the shipped actor is tanh(loc).
        distribution_kwargs={"tanh_loc": False},
        return_log_prob=True,
    )


def _collect(env: CopiedEnv, policy: ProbabilisticActor) -> TensorDict:
    """One episode of every copy: (T, R) transitions."""
    observation, over = env.reset(), False
    steps = []
    while not over:
        with torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
            step = policy(
                TensorDict({"observation": torch.as_tensor(observation, dtype=torch.float32)}, [len(observation)])
            )
        observation, reward, over = env.step(step["action"].numpy().astype(np.float64))
        step["reward"] = torch.as_tensor(reward, dtype=torch.float32)[:, None]
        step["after"] = torch.as_tensor(observation, dtype=torch.float32)
        steps.append(step)
    return torch.stack(steps)


def _with_advantage(round_: TensorDict, critic: ValueOperator, config: PpoConfig) -> TensorDict:
    with torch.no_grad():
        value = critic.module(round_["observation"])
        after = critic.module(round_["after"])
    done = torch.zeros_like(value, dtype=torch.bool)
    done[-1] = True
    # The horizon truncates an episode: the value of later steps still counts.
    advantage, target = generalized_advantage_estimate(
        config.gamma, config.lambda_, value, after, round_["reward"], done, torch.zeros_like(done), time_dim=0
    )
    round_["advantage"], round_["value_target"] = advantage, target
    return round_.reshape(-1)


def _learn(data: TensorDict, loss: ClipPPOLoss, optimizer: torch.optim.Optimizer, config: PpoConfig) -> None:
    for _ in range(config.epochs):
        for rows in torch.split(torch.randperm(len(data)), config.batch):
            losses = loss(data[rows])
            total = losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]
            optimizer.zero_grad()
            total.backward()
            nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
            optimizer.step()
