"""RLfOLD: SAC whose batch also has the label of an expert, and an expert that drives where the policy is uncertain.

Which loss moves what, beyond `sac`: the imitation's loss on the same batch moves the actor *and* the encoder. The
expert's label is stored with every transition, in one replay; only the target speed is imitated.

Source: Coelho 2024, algorithm 1. All losses are minimised in one step here, one after the other there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any, Final, Literal

import torch
from pydantic import Field
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from dohyo.agents.learning.algorithms.sac import Auxiliary, Sac, SacConfig
from dohyo.agents.learning.experience.behaviour import Act, Behaviour, PolicyBehaviour, UncertaintyGate
from dohyo.agents.learning.experience.collector import Finished
from dohyo.agents.learning.experience.replay import ReplayConfig
from dohyo.agents.learning.files.metrics import Number
from dohyo.agents.learning.networks.distributions import squashed_gaussian
from dohyo.agents.learning.runs.config import Positive, Share
from dohyo.agents.rlfold.two_deviations import TwoDeviationsHead, truncated_log_density

SPEED, STEERING = 0, 1
"""Components of an action."""
DEVIATION: Final = "speed_deviation"
EXTRAS: Final = {"label": torch.zeros(2), "labelled": torch.tensor(False)}
"""What the replay keeps of a step beside its transition."""


class RlfoldConfig(SacConfig):
    """Settings; the defaults are the thesis's, but for sizes that a processor can learn with.

    Attributes:
        imitation: Likelihood under sigma_IL, squared error (without a second deviation), or none.
        imitated: Components of the action that are imitated.
        imitation_weight: Of its loss.
        bounded: Whether the mean is in [-1, 1] before the squashing, as in the release; see `TwoDeviationsHead`.
        gate: Who drives: the expert where sigma_RL of the speed exceeds `threshold`, or in a random `expert_share` of
            the steps, or never.
        threshold: u of the thesis.
        expert_share: p of the thesis.
    """

    replay: ReplayConfig = ReplayConfig(capacity=100_000)
    batch: Positive = 128
    gamma: Share = 0.85
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    tau: Share = 0.01
    initial_alpha: Annotated[float, Field(gt=0)] = 0.2
    learning_starts: Annotated[int, Field(ge=0)] = 1024
    imitation: Literal["likelihood", "squared", "none"] = "likelihood"
    imitated: Literal["speed", "speed-and-steering"] = "speed"
    imitation_weight: Annotated[float, Field(ge=0)] = 1.0
    bounded: bool = False
    gate: Literal["uncertainty", "share", "never"] = "uncertainty"
    threshold: Annotated[float, Field(gt=0)] = 0.8
    expert_share: Share = 0.3

    @property
    def components(self) -> list[int]:
        """Numbers of the action that are imitated."""
        return [SPEED] if self.imitated == "speed" else [SPEED, STEERING]


class Imitation(Auxiliary):
    """Distance of the policy from the labels of a batch."""

    name = "loss_imitation"

    def __init__(
        self,
        imitating: Callable[[Tensor], tuple[Tensor, Tensor]],
        vector: Callable[[Tensor], Tensor],
        config: RlfoldConfig,
    ) -> None:
        """Prepares.

        Args:
            imitating: See `TwoDeviationsHead`.
            vector: From labels of the action space to [-1, 1]^A.
            config: Names the loss and its components.
        """
        super().__init__()
        self._imitating, self._vector, self._config = imitating, vector, config

    def forward(self, batch: TensorDictBase, features: Tensor) -> Tensor:
        """See `Auxiliary`."""
        mean, std = (part[:, self._config.components] for part in self._imitating(features))
        label = self._vector(batch["label"])[:, self._config.components]
        if self._config.imitation == "squared":
            errors = (label - mean).square()
        else:
            errors = -truncated_log_density(label, mean, std)
        known = batch["labelled"].float()
        total: Tensor = (errors.sum(dim=-1) * known).sum() / known.sum().clamp(min=1.0)
        return self._config.imitation_weight * total


class Rlfold(Sac):
    """See the module."""

    _config: RlfoldConfig

    def __init__(self, *args: Any, **options: Any) -> None:
        """See `Sac`."""
        super().__init__(*args, make_behaviour=self._make_behaviour, **options)

    def make_actor(self, features: int) -> TwoDeviationsHead:
        """See `Sac`; the imitation's loss is of this actor."""
        actor = TwoDeviationsHead(features, self._unit.size, self._config.hidden, self._config.bounded)
        if self._config.imitation != "none":
            self.auxiliary.append(Imitation(actor.imitating, self._unit, self._config))
        return actor

    def explore(self, observation: TensorDictBase) -> dict[str, Tensor]:
        """Draws from the policy, and says how uncertain it is of its speed."""
        mean, log_std = self.actor(self.encoder(observation))
        action, _ = squashed_gaussian(mean, log_std)
        return {"action": self._unit.inverse(action), DEVIATION: log_std[:, SPEED].exp()}

    @property
    def columns(self) -> tuple[str, ...]:
        """See `OffPolicy`."""
        return (*super().columns, "demonstrated_steps")

    def shares(self, episodes: Sequence[Finished]) -> dict[str, Number]:
        """Also the share of the steps whose speed was the expert's."""
        steps = sum(episode.length for episode in episodes)
        taken = sum(episode.demonstrated * episode.length for episode in episodes)
        return {**super().shares(episodes), "demonstrated_steps": taken / max(steps, 1)}

    def _make_behaviour(self, policy: Act) -> Behaviour:
        config = self._config
        if config.gate == "never":
            return PolicyBehaviour(policy, labels=config.imitation != "none")
        if config.gate == "uncertainty":
            return UncertaintyGate(policy, deviation_of, config.threshold, [SPEED])
        # The same gate with a coin in place of the uncertainty.
        return UncertaintyGate(policy, coin_of, 1.0 - config.expert_share, [SPEED])


def coin_of(chosen: TensorDict) -> Tensor:
    """(N,) drawn in [0, 1), whatever the deviation is; 0 for the random actions before the learning starts."""
    return torch.rand(len(chosen)) if DEVIATION in chosen else torch.zeros(len(chosen))


def deviation_of(chosen: TensorDict) -> Tensor:
    """(N,) sigma_RL of the speed; 0 for the random actions before the learning starts."""
    found: Tensor | None = chosen.get(DEVIATION, None)
    return torch.zeros(chosen.batch_size) if found is None else found
