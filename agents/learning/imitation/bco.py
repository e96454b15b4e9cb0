"""BCO: behavioural cloning from observation (Torabi et al. 2018), for demonstrations without the expert's actions.

An inverse dynamics model p(a | o, o') learns from the learner's own experience, by maximum likelihood. The demonstrated
transitions get its most likely actions; behavioural cloning then learns from them. DPPO-IL (Albilani 2023) fits the
model to demonstrated transitions with their actions instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal

import gymnasium
import torch
from gymnasium import spaces
from pydantic import Field
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn
from torch.distributions import Categorical, Distribution, Independent, Normal
from torchrl.modules import MLP

from dohyo.agents.learning.experience.behaviour import Behaviour
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.imitation.behaviour_cloning import Labels, Loss, cloning_loss
from dohyo.agents.learning.networks.modules import ObservationEncoder
from dohyo.agents.learning.networks.policy import PpoActor
from dohyo.agents.learning.networks.vectors import ActionVector
from dohyo.agents.learning.runs.config import Positive
from dohyo.sumo_networks.config import Config


class InverseDynamicsConfig(Config):
    """Settings of the inverse dynamics model; all are ours, since the paper has other networks for each problem.

    Attributes:
        hidden: Width of each hidden layer.
        learning_rate: Of Adam, at the start; it falls as a half cosine.
        batch: Transitions in a gradient step.
        epochs: Passes over the experience.
    """

    hidden: Annotated[tuple[Positive, ...], Field(min_length=1)] = (128, 128)
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    batch: Positive = 128
    epochs: Positive = 30


class BcoConfig(Config):
    """Settings of BCO; all are ours, the thesis of the parking system has none.

    Attributes:
        experience: What the inverse dynamics model learns from: "own" steps, or the "demonstrated" ones with actions.
        steps: Of own experience, of all environments together, in each iteration.
        iterations: Times that experience is added, the actions are inferred, and the policy is fitted; with more than
            one this is BCO(alpha).
        inverse: Settings of the inverse dynamics model, the table [inverse].
        loss: See `PolicyConfig`.
        learning_rate: Of Adam, for the policy; it falls as a half cosine in each iteration.
        batch: Demonstrated transitions in a gradient step.
        passes: Passes over the demonstrations in each iteration.
    """

    experience: Literal["own", "demonstrated"] = "own"
    steps: Positive = 4096
    iterations: Positive = 1
    inverse: InverseDynamicsConfig = InverseDynamicsConfig()
    loss: Loss = "likelihood"
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    batch: Positive = 128
    passes: Positive = 30


class InverseDynamics(nn.Module):
    """Action between two observations: a Gaussian in [-1, 1]^A with learned deviations, or a categorical one."""

    def __init__(
        self,
        observations: spaces.Dict,
        actions: gymnasium.Space[Any],
        config: InverseDynamicsConfig,
        device: torch.device,
        encoder: nn.Module | None = None,
    ) -> None:
        """Draws weights from torch's generator.

        Args:
            observations: Space of one observation.
            actions: Space of one action.
            config: Settings.
            device: Of the model.
            encoder: Named observations -> (B, `features`), without weights; None: vectors are joined.

        Raises:
            InvalidInputError: The observations hold pictures, and there is no encoder.
        """
        super().__init__()
        self._config, self._device = config, device
        self._observation, self._action = encoder or ObservationEncoder(observations), ActionVector(actions)
        features: int = self._observation.features  # type: ignore[assignment]
        self._body = MLP(2 * features, self._action.size, num_cells=config.hidden)
        self._log_std = nn.Parameter(torch.zeros(self._action.size))
        self.to(device)
        self._optimizer = torch.optim.Adam(self.parameters(), lr=config.learning_rate)

    def distribution(self, transitions: TensorDictBase) -> Distribution:
        """Distribution of the actions of (B,) transitions, in [-1, 1]^A or over their numbers."""
        told = self._told(transitions)
        if self._action.discrete:
            return Categorical(logits=told)
        return Independent(Normal(told, self._log_std.exp()), 1)

    def fit(self, experience: TensorDictBase) -> float:
        """Maximises the likelihood of the actions of (B,) own transitions; returns the last pass's mean loss."""
        size, batch = len(experience), self._config.batch
        for epoch in range(self._config.epochs):
            set_rate(self._optimizer, self._config.learning_rate * cosine(epoch / self._config.epochs))
            total = 0.0
            for rows in torch.split(torch.randperm(size), batch):
                action = experience["action"][rows].to(self._device)
                wanted = action if self._action.discrete else self._action(action)
                loss = -self.distribution(experience[rows]).log_prob(wanted).mean()
                self._optimizer.zero_grad(set_to_none=True)
                loss.backward()  # type: ignore[no-untyped-call]
                self._optimizer.step()
                total += loss.item() * len(rows)
        return total / size

    @torch.no_grad()
    def label(self, demonstrations: TensorDictBase) -> TensorDictBase:
        """Copy of (B,) demonstrated transitions with the most likely actions, in the action space."""
        return demonstrations.copy().set("action", self._action.inverse(self._told(demonstrations)).cpu())

    def _told(self, transitions: TensorDictBase) -> Tensor:
        before = self._observation(transitions["observation"]).to(self._device)
        after = self._observation(transitions["next", "observation"]).to(self._device)
        told: Tensor = self._body(before, after)
        return told


class Bco:
    """Fits a policy to demonstrated observations.

    Attributes:
        demonstrations: (D,) transitions.
        inverse: The inverse dynamics model.
    """

    def __init__(
        self,
        demonstrations: TensorDictBase,
        observations: spaces.Dict,
        actions: gymnasium.Space[Any],
        config: BcoConfig,
        device: torch.device,
        encoder: nn.Module | None = None,
    ) -> None:
        """Draws weights from torch's generator.

        Args:
            demonstrations: (D,) transitions; their actions are read only if the experience is the demonstrated one.
            observations: Space of one observation.
            actions: Space of one action.
            config: Settings.
            device: Of the model.
            encoder: See `InverseDynamics`.

        Raises:
            InvalidInputError: The observations hold pictures, and there is no encoder.
        """
        self.demonstrations, self._config = demonstrations, config
        self.inverse = InverseDynamics(observations, actions, config.inverse, device, encoder)

    def learn(
        self,
        actor: PpoActor,
        features: Callable[[TensorDictBase], Tensor],
        collector: Collector,
        behaviour: Behaviour,
    ) -> None:
        """Collects experience, infers the demonstrated actions, and fits the policy to them.

        Args:
            actor: The policy.
            features: Named observations (B, *) -> (B, O), on the networks' device.
            collector: Gives the experience.
            behaviour: Of the policy, with its exploration.
        """
        config, experience, labels = self._config, list[TensorDictBase](), Labels()
        optimizer = torch.optim.Adam(actor.parameters(), lr=config.learning_rate)

        def loss(rows: TensorDictBase) -> Tensor:
            seen = features(rows["observation"])
            return cloning_loss(actor, seen, rows["label"].to(seen.device), config.loss)

        for _ in range(config.iterations):
            if config.experience == "demonstrated":
                experience = [self.demonstrations]
            else:
                experience.append(_driven(collector, behaviour, config.steps))
            self.inverse.fit(TensorDict.cat(experience))
            told = self.inverse.label(self.demonstrations)
            labels.rows = TensorDict({"observation": told["observation"], "label": told["action"]}, told.batch_size)
            for done in range(config.passes):
                set_rate(optimizer, config.learning_rate * cosine(done / config.passes))
                labels.fit(optimizer, loss, 1, config.batch)


def cosine(done: float) -> float:
    """Factor of the learning rate after a share of the passes: from 1 to nearly 0 (Loshchilov and Hutter 2017)."""
    return 0.5 * (1.0 + math.cos(math.pi * done))


def set_rate(optimizer: torch.optim.Optimizer, rate: float) -> None:
    """Sets the learning rate of all parameters."""
    for group in optimizer.param_groups:
        group["lr"] = rate


def _driven(collector: Collector, behaviour: Behaviour, count: int) -> TensorDictBase:
    """Transitions of a number of steps, of all environments together."""
    steps = [collector.step(behaviour) for _ in range(max(count // len(collector), 1))]
    collector.finished()
    kept = [step[step["active"]].select("observation", "action", ("next", "observation")) for step in steps]
    return TensorDict.cat(kept)
