"""GAIL: generative adversarial imitation learning (Ho and Ermon 2016), as a reward for a policy-gradient learner.

A discriminator D separates the expert's transitions from the policy's: it maximises E_expert[log D] +
E_policy[log(1 - D)]. The policy is rewarded with -log(1 - D), which is high where its transitions pass as the expert's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import gymnasium
import torch
from gymnasium import spaces
from pydantic import Field
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor, nn
from torchrl.modules import MLP
from torchrl.objectives import GAILLoss

from dohyo.agents.learning.files.metrics import Number
from dohyo.agents.learning.networks.modules import ObservationEncoder
from dohyo.agents.learning.networks.vectors import ActionVector
from dohyo.agents.learning.runs.config import Positive
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError


class GailConfig(Config):
    """Settings of the discriminator and its reward. Defaults: Unity ML-Agents, where not marked as ours.

    Attributes:
        sees: "action": the discriminator sees (o, a); "next": (o, o'), which needs no actions of the expert (GAIfO,
            Torabi et al. 2018).
        strength: Factor of the reward.
        hidden: Width of each hidden layer.
        learning_rate: Of Adam.
        batch: Transitions of each kind in a gradient step.
        updates: Gradient steps per round of the policy (ours).
        gradient_penalty: Weight of the penalty that holds the discriminator's gradient near norm 1; 0: none.
    """

    sees: Literal["action", "next"] = "action"
    strength: Annotated[float, Field(gt=0)] = 1.0
    hidden: Annotated[tuple[Positive, ...], Field(min_length=1)] = (128, 128)
    learning_rate: Annotated[float, Field(gt=0)] = 3e-4
    batch: Positive = 128
    updates: Positive = 16
    gradient_penalty: Annotated[float, Field(ge=0)] = 10.0


class Gail:
    """Discriminator between the expert and the policy; an `IntrinsicReward`."""

    columns: tuple[str, ...] = ("gail_reward", "gail_loss", "gail_expert", "gail_policy")

    def __init__(
        self,
        demonstrations: TensorDictBase,
        observations: spaces.Dict,
        actions: gymnasium.Space[Any],
        config: GailConfig,
        device: torch.device,
        encoder: nn.Module | None = None,
    ) -> None:
        """Draws weights from torch's generator.

        Args:
            demonstrations: (D,) transitions of the expert.
            observations: Space of one observation.
            actions: Space of one action.
            config: Settings.
            device: Of the discriminator.
            encoder: Named observations -> (B, `features`), without weights; None: vectors are joined.

        Raises:
            InvalidInputError: There is no transition of the expert, or the observations hold pictures without an
                encoder.
        """
        if not len(demonstrations):
            raise InvalidInputError("expected transitions of an expert for GAIL, got none")
        self._config, self._device = config, device
        self._observation = encoder or ObservationEncoder(observations)
        self._action = ActionVector(actions).to(device)
        features: int = self._observation.features  # type: ignore[assignment]
        size = self._action.size if config.sees == "action" else features
        self._logit = MLP(features + size, 1, num_cells=config.hidden, device=device)
        discriminator = TensorDictSequential(
            TensorDictModule(self._logit, in_keys=["observation", "action"], out_keys=["logit"]),
            TensorDictModule(nn.Sigmoid(), in_keys=["logit"], out_keys=["d_logits"]),  # TorchRL's name for D
        )
        penalised = config.gradient_penalty > 0
        self._loss = GAILLoss(discriminator, use_grad_penalty=penalised, gp_lambda=config.gradient_penalty)
        self._optimizer = torch.optim.Adam(self._logit.parameters(), lr=config.learning_rate)
        self._expert = self._seen(demonstrations)

    @torch.no_grad()
    def reward(self, transitions: TensorDictBase) -> Tensor:
        """(B, 1) strength times -log(1 - D): with the logit l of D this is softplus(l), which stays finite."""
        logit: Tensor = self._logit(*self._seen(transitions))
        return self._config.strength * nn.functional.softplus(logit).to(transitions.device or "cpu")

    def update(self, transitions: TensorDictBase) -> Mapping[str, Number]:
        """Gradient steps of the discriminator on the expert's and the policy's transitions.

        Returns:
            Mean loss, and mean D of a batch of the expert's and of one of the policy's transitions after the steps.
        """
        policy, total = self._seen(transitions), 0.0
        for _ in range(self._config.updates):
            (seen, second), (own_seen, own_second) = self._drawn(self._expert), self._drawn(policy)
            names = ("observation", "action", "collector_observation", "collector_action")
            batch = TensorDict(
                dict(zip(names, (seen, second, own_seen, own_second), strict=True)), [self._config.batch]
            )
            loss = self._loss(batch)["loss"]
            self._optimizer.zero_grad(set_to_none=True)
            loss.backward()
            self._optimizer.step()
            total += loss.item()
        return {
            "gail_loss": total / self._config.updates,
            "gail_expert": self._output(self._drawn(self._expert)),
            "gail_policy": self._output(self._drawn(policy)),
        }

    def state(self) -> dict[str, Any]:
        """State for a checkpoint."""
        return {"discriminator": self._logit.state_dict(), "optimizer": self._optimizer.state_dict()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""
        self._logit.load_state_dict(state["discriminator"])
        self._optimizer.load_state_dict(state["optimizer"])

    def _seen(self, transitions: TensorDictBase) -> tuple[Tensor, Tensor]:
        """The two inputs of the discriminator, (B, F) and (B, A or F)."""
        observation = self._observation(transitions["observation"]).to(self._device)
        if self._config.sees == "next":
            return observation, self._observation(transitions["next", "observation"]).to(self._device)
        return observation, self._action(transitions["action"].to(self._device))

    def _drawn(self, rows: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
        """A batch of rows, drawn with replacement."""
        index = torch.randint(len(rows[0]), (self._config.batch,)).to(self._device)
        return rows[0][index], rows[1][index]

    @torch.no_grad()
    def _output(self, rows: tuple[Tensor, Tensor]) -> float:
        return float(torch.sigmoid(self._logit(*rows)).mean())
