"""MA-POCA: multi-agent posthumous credit assignment (Cohen et al. 2021), on PPO.

K agents share a policy and the sum of their rewards. One critic sees all agents through attention. The advantage of
agent j is the return minus a counterfactual baseline, which sees the actions of all agents but j:

    V(s) = h(RSA({g(o_i)})),    b_j(s, a_-j) = h'(RSA({g(o_j)} + {f(o_i, a_i), i != j})),    A_j = G - b_j.

An agent whose episode has ended is in no attention, instead of in an absorbing state; since G goes on with the rewards
of the others, its last actions still get their credit. With K = 1 this is PPO with an attention critic.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import gymnasium
import torch
from pydantic import Field
from tensordict import TensorDict
from torch import Tensor, nn
from torch.nn.functional import smooth_l1_loss
from torchrl.objectives.value.functional import generalized_advantage_estimate

from dohyo.agents.learning.algorithms.ppo import Ppo, explained_variance
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig
from dohyo.agents.learning.files.metrics import Number
from dohyo.agents.learning.networks.policy import Actor, distribution_at, normalised
from dohyo.agents.learning.networks.vectors import ActionVector
from dohyo.agents.learning.runs.config import Positive
from dohyo.agents.learning.tasks.task import Task
from dohyo.sumo_networks.errors import InvalidInputError


class PocaConfig(PpoConfig):
    """Settings of MA-POCA beside those of PPO. Defaults: Unity ML-Agents.

    Attributes:
        embedding: Numbers in an entity of the attention; a multiple of `heads`.
        heads: Of the attention.
        baseline_scale: Weight of the baseline's loss beside that of the value.
    """

    embedding: Positive = 128
    heads: Positive = 4
    baseline_scale: Annotated[float, Field(ge=0)] = 0.5


class ResidualSelfAttention(nn.Module):
    """Entities -> one vector: attention with a residual connection, averaged over the active entities."""

    def __init__(self, size: int, heads: int) -> None:
        super().__init__()
        self.before, self.after = nn.LayerNorm(size), nn.LayerNorm(size)
        self.attention = nn.MultiheadAttention(size, heads, batch_first=True)

    def forward(self, entities: Tensor, active: Tensor) -> Tensor:
        """(B, K, E) entities, of which (B, K) are active -> (B, E); 0 where none is active."""
        seen = self.before(entities)
        nobody = ~active.any(dim=1, keepdim=True)
        mixed, _ = self.attention(seen, seen, seen, key_padding_mask=~(active | nobody), need_weights=False)
        weight = active / active.sum(dim=1, keepdim=True).clamp_min(1)
        pooled: Tensor = (self.after(entities + mixed) * weight[..., None]).sum(dim=1)
        return pooled


class GroupCritic(nn.Module):
    """Value of a group of agents, and the counterfactual baseline of each of them.

    Attributes:
        actor: Gives the normalisation of the observations.
    """

    def __init__(self, actor: nn.Module, features: int, actions: gymnasium.Space[Any], config: PocaConfig) -> None:
        super().__init__()
        size = config.embedding
        self._actor = [actor]  # in a list, since its weights are not the critic's
        self._action = ActionVector(actions)
        self.observed = nn.Sequential(nn.Linear(features, size), nn.Tanh())
        self.acted = nn.Sequential(nn.Linear(features + self._action.size, size), nn.Tanh())
        self.value_attention = ResidualSelfAttention(size, config.heads)
        self.baseline_attention = ResidualSelfAttention(size, config.heads)
        self.value_head, self.baseline_head = _head(size, config.hidden), _head(size, config.hidden)

    def forward(self, features: Tensor, active: Tensor) -> Tensor:
        """Value of (B, K, O) agents, of which (B, K) are active: (B, 1)."""
        value: Tensor = self.value_head(self.value_attention(self.observed(self._normalised(features)), active))
        return value

    def baselines(self, features: Tensor, actions: Tensor, active: Tensor) -> Tensor:
        """(B, K) counterfactual baseline of each agent; that of an agent does not depend on its own action.

        Args:
            features: (B, K, O).
            actions: (B, K, ...) in the action space.
            active: (B, K).
        """
        seen = self._normalised(features)
        observed, acted = self.observed(seen), self.acted(torch.cat([seen, self._action(actions)], dim=-1))
        count = active.shape[1]
        own = torch.eye(count, dtype=torch.bool, device=active.device)[:, :, None]
        # (B, K, K, E): in the group of agent j, j is without its action.
        groups = torch.where(own, observed[:, None], acted[:, None]).flatten(0, 1)
        pooled = self.baseline_attention(groups, active.repeat_interleave(count, dim=0))
        baselines: Tensor = self.baseline_head(pooled)
        return baselines.reshape(-1, count)

    def _normalised(self, features: Tensor) -> Tensor:
        actor = self._actor[0]
        return normalised(features, actor.shift, actor.scale) if isinstance(actor, Actor) else features


class Poca(Ppo):
    """MA-POCA on a collector's rows, whose groups are the teams."""

    _config: PocaConfig

    def _critic(self, task: Task) -> nn.Module:
        config = self._config
        if config.imitated_steps:
            raise InvalidInputError(
                f"expected imitated_steps = 0 with MA-POCA, whose critic sees teams, got {config.imitated_steps}"
            )
        if config.embedding % config.heads:
            raise InvalidInputError(
                f"MA-POCA: expected embedding to be a multiple of heads, {config.heads}, got {config.embedding}"
            )
        return GroupCritic(self.actor, self.encoder.features, task.action_space, config)  # type: ignore[arg-type]

    @property
    def _agents(self) -> int:
        return self._collector.group_size

    def _judge(self, batch: TensorDict) -> None:
        """Adds the densities, the team's value and return, and each agent's baseline and advantage."""
        features = self._features(batch["observation"])
        batch["action_log_prob"] = distribution_at(self.actor, features).log_prob(batch["action"])
        team, active = self._teams(features), self._teams(batch["active"])
        value = self._value(team.flatten(0, 1), active.flatten(0, 1)).reshape(*active.shape[:2], 1)
        target = self._returns(batch, value)
        actions = self._teams(self.actor.action_of(batch["action"]))
        baselines = self._value.baselines(team.flatten(0, 1), actions.flatten(0, 1), active.flatten(0, 1))  # type: ignore[operator]
        batch["state_value"], batch["value_target"] = self._rows(value), self._rows(target)
        batch["advantage"] = self._agent_rows(target - baselines.reshape(active.shape))

    def _returns(self, batch: TensorDict, value: Tensor) -> Tensor:
        """(G, T, 1) lambda-returns of the teams."""
        after, active = batch["next"], self._teams(batch["active"])
        ended = self._teams(after["done"][..., 0])
        alive = active & ~self._teams(after["terminated"][..., 0])  # a truncated agent's future still counts
        reward = (self._teams(after["reward"][..., 0]) * active).sum(dim=-1, keepdim=True)
        seen = self._teams(self._features(after["observation"]))
        value_next = self._value(seen.flatten(0, 1), alive.flatten(0, 1)).reshape(value.shape)
        done, terminated = ~(active & ~ended).any(dim=-1, keepdim=True), ~alive.any(dim=-1, keepdim=True)
        done[:, :-1] |= ~active[:, 1:].any(dim=-1, keepdim=True)  # as in `Ppo`, before a step that was lost
        config = self._config
        _, target = generalized_advantage_estimate(
            config.gamma, config.gae_lambda, value, value_next, reward, done, terminated, time_dim=1
        )
        returns: Tensor = target
        return returns

    def _teams(self, rows: Tensor) -> Tensor:
        """(G * K, T, ...) rows -> (G, T, K, ...)."""
        return rows.reshape(-1, self._agents, *rows.shape[1:]).transpose(1, 2)

    def _agent_rows(self, teams: Tensor) -> Tensor:
        """(G, T, K) values of agents -> (G * K, T, 1)."""
        return teams.transpose(1, 2).flatten(0, 1)[..., None]

    def _rows(self, teams: Tensor) -> Tensor:
        """(G, T, 1) values of teams -> (G * K, T, 1), the same for all agents of a team."""
        return self._agent_rows(teams.expand(*teams.shape[:2], self._agents))

    def _learn(self, batch: TensorDict) -> dict[str, Number]:
        """See `Ppo`; a row of a batch is a team."""
        active = self._teams(batch["active"]).flatten(0, 1)
        names = {name: self._teams(batch["observation", name]).flatten(0, 1) for name in self._names}
        action, log_prob = (self._teams(batch[name]).flatten(0, 1) for name in ("action", "action_log_prob"))
        gain, target = (self._teams(batch[name][..., 0]).flatten(0, 1) for name in ("advantage", "value_target"))
        lived = gain[active]
        if len(lived) > 1:  # a single one has no variance
            gain = (gain - lived.mean()) / lived.std().clamp(min=1e-6)
        value = self._teams(batch["state_value"][..., 0]).flatten(0, 1)
        row: dict[str, Number] = {"explained_variance": explained_variance(value[active], target[active])}

        teams = active.any(dim=1).nonzero().flatten()  # others sit out

        def losses(drawn: Tensor) -> dict[str, Tensor]:
            rows = teams[drawn]
            seen = {name: one[rows] for name, one in names.items()}
            return self._team_losses(seen, action[rows], log_prob[rows], gain[rows], target[rows], active[rows])

        return row | self._descend(len(teams), max(self._config.batch // self._agents, 1), losses)

    def _team_losses(
        self,
        observation: Mapping[str, Tensor],
        action: Tensor,
        log_prob: Tensor,
        gain: Tensor,
        target: Tensor,
        active: Tensor,
    ) -> dict[str, Tensor]:
        """Losses of (B, K) agents, of which those that are active count."""
        config, features = self._config, self.encoder(observation)
        policy = self._policy_losses(features[active], action[active], log_prob[active], gain[active])
        value = self._value(features, active).expand_as(target)
        baselines = self._value.baselines(features, self.actor.action_of(action), active)  # type: ignore[operator]
        of_value, of_baseline = (smooth_l1_loss(one[active], target[active]) for one in (value, baselines))
        return policy | {"loss_critic": config.value_scale * (of_value + config.baseline_scale * of_baseline)}


def _head(size: int, hidden: tuple[int, ...]) -> nn.Sequential:
    """Layers from a pooled entity to one number."""
    parts: list[nn.Module] = []
    for before, after in zip((size, *hidden), hidden, strict=False):
        parts += [nn.Linear(before, after), nn.Tanh()]
    return nn.Sequential(*parts, nn.Linear(hidden[-1], 1))
