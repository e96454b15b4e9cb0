"""Every setting of PPO, with its unit and the source of its default."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from dohyo.agents.learning.runs.config import Positive, RunConfig, Share
from dohyo.sumo_networks.config import Config


class PpoConfig(Config):
    """Proximal policy optimisation, and the share of episodes that an expert drives.

    The defaults are those of Albilani 2023, table 6.1; those marked as ours are not in it.

    Attributes:
        horizon: Steps of every environment between two updates: a round.
        learning_rate: Of Adam, at the start.
        learning_rate_decay: Factor of the learning rate per round.
        epochs: Passes over a round.
        batch: Transitions per gradient step.
        clip: Bound of the probability ratio.
        gamma: Discount per step.
        gae_lambda: Lambda of the generalised advantage.
        entropy: Weight of the entropy bonus.
        value_scale: Weight of the critic's loss.
        initial_std: Standard deviation of the actions at the start, where the action space is [-1, 1].
        gradient_norm: Upper bound (ours).
        reward_scale: Factor of the rewards that the critic learns (ours); reported returns are without it.
        squashed: Whether actions are squashed by tanh, with a deviation that depends on the observation (ours).
        normalised: Whether observations are normalised by their mean and deviation so far (ours).
        hidden: Width of each hidden layer of actor and critic (ours).
        guided_share: p, the probability that an episode is driven by the task's expert, and stored as if on-policy
            (GPPO; the thesis tries up to 0.2).
        imitated_steps: Steps before the first round in which the expert is imitated; 0: none (ours).
        guided_decay: Factor of p per round (ours; the thesis: p falls as the policy improves).
    """

    horizon: Positive = 128
    learning_rate: Annotated[float, Field(gt=0)] = 1e-4
    learning_rate_decay: Annotated[float, Field(gt=0, le=1)] = 0.9995
    epochs: Positive = 3
    batch: Positive = 32
    clip: Annotated[float, Field(gt=0, lt=1)] = 0.2
    gamma: Share = 0.99
    gae_lambda: Share = 0.95
    entropy: Annotated[float, Field(ge=0)] = 0.01
    value_scale: Annotated[float, Field(ge=0)] = 1.0
    initial_std: Annotated[float, Field(gt=0)] = 1.0
    gradient_norm: Annotated[float, Field(gt=0)] = 0.5
    reward_scale: Annotated[float, Field(gt=0)] = 1.0
    squashed: bool = False
    normalised: bool = False
    hidden: Annotated[tuple[Positive, ...], Field(min_length=1)] = (256, 256)
    guided_share: Share = 0.0
    imitated_steps: Annotated[int, Field(ge=0)] = 0
    guided_decay: Annotated[float, Field(gt=0, le=1)] = 0.9995

    def guided_share_at(self, round_: int) -> float:
        """Guided share p in one round, counted from 0."""
        return self.guided_share * self.guided_decay**round_


class PpoRunConfig(RunConfig):
    """A run of PPO; a trainer derives from it and adds the settings of its task.

    Attributes:
        ppo: The algorithm's settings, the table [ppo].
    """

    ppo: PpoConfig = PpoConfig()
