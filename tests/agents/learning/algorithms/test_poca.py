"""MA-POCA: the counterfactual baseline, agents that have ended, and returns by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from tensordict import TensorDict

from dohyo.agents.learning.algorithms.poca import GroupCritic, Poca, PocaConfig
from dohyo.agents.learning.algorithms.ppo import Ppo
from dohyo.sumo_networks.errors import InvalidInputError

ACTIONS = Box(-1.0, 1.0, (2,), np.float32)
SEEN = Box(-1.0, 1.0, (3,), np.float32)
TASK: Any = SimpleNamespace(name="toy", observation_space=SEEN, action_space=ACTIONS, has_expert=True)
CONFIG = PocaConfig(
    embedding=8, heads=2, hidden=(8,), gamma=0.5, gae_lambda=1.0, squashed=True, epochs=1, batch=4, entropy=0.0
)


def poca(agents: int, config: PocaConfig = CONFIG) -> Poca:
    torch.manual_seed(0)
    collector: Any = SimpleNamespace(group_size=agents)
    return Poca(TASK, collector, config, torch.device("cpu"))


def constant_value(learner: Ppo) -> None:
    """Makes value and baseline zero everywhere."""
    with torch.no_grad():
        for weight in learner._value.parameters():
            weight.zero_()


@torch.no_grad()
def judge(learner: Poca, batch: TensorDict) -> None:
    learner._judge(batch)


def experience(rewards: list[list[float]], lengths: list[int]) -> TensorDict:
    """(K, T) steps of one team whose agents end after some steps."""
    agents, steps = len(rewards), len(rewards[0])
    time = torch.arange(steps).expand(agents, steps)
    ended = (time == torch.tensor(lengths)[:, None] - 1)[..., None]
    after = {
        "observation": TensorDict({"observation": torch.randn(agents, steps, 3)}, [agents, steps]),
        "reward": torch.tensor(rewards)[..., None],
        "terminated": ended,
        "done": ended,
    }
    seen = TensorDict({"observation": torch.randn(agents, steps, 3)}, [agents, steps])
    rows = {"observation": seen, "action": torch.rand(agents, steps, 2) - 0.5, "next": after}
    return TensorDict({**rows, "active": time < torch.tensor(lengths)[:, None]}, [agents, steps])


def test_the_baseline_of_an_agent_sees_the_others_actions_and_not_its_own() -> None:
    torch.manual_seed(0)
    critic = GroupCritic(torch.nn.Identity(), 3, ACTIONS, CONFIG)
    seen, actions = torch.randn(1, 3, 3), torch.rand(1, 3, 2) - 0.5
    active = torch.tensor([[True, True, False]])
    before = critic.baselines(seen, actions, active)
    actions[0, 0] += 0.3
    after = critic.baselines(seen, actions, active)
    assert torch.allclose(before[0, 0], after[0, 0], atol=1e-6)
    assert abs(before[0, 1] - after[0, 1]) > 1e-4


def test_an_agent_that_has_ended_is_seen_by_nobody() -> None:
    torch.manual_seed(0)
    critic = GroupCritic(torch.nn.Identity(), 3, ACTIONS, CONFIG)
    seen, actions = torch.randn(1, 3, 3), torch.rand(1, 3, 2) - 0.5
    active = torch.tensor([[True, True, False]])
    value, baselines = critic(seen, active), critic.baselines(seen, actions, active)
    seen[0, 2] += 5.0
    actions[0, 2] += 0.3
    assert torch.allclose(critic(seen, active), value, atol=1e-6)
    assert torch.allclose(critic.baselines(seen, actions, active)[:, :2], baselines[:, :2], atol=1e-6)
    assert not torch.allclose(critic(seen, torch.ones_like(active)), value, atol=1e-4)


def test_an_agent_that_ends_early_is_credited_for_the_success_of_its_mate() -> None:
    learner = poca(2)
    constant_value(learner)
    batch = experience([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], lengths=[1, 3])
    judge(learner, batch)
    assert batch["value_target"][:, :, 0].tolist() == [[0.25, 0.5, 1.0]] * 2
    assert batch["advantage"][0, 0, 0] == pytest.approx(0.25)


def test_a_truncated_team_is_valued_at_its_last_observation_and_a_terminated_one_is_not() -> None:
    learner = poca(1)
    constant_value(learner)
    with torch.no_grad():
        learner._value.value_head[-1].bias.fill_(4.0)  # type: ignore[union-attr, index, operator]
    batch = experience([[1.0, 1.0]], lengths=[2])
    judge(learner, batch)
    assert batch["value_target"][0, 1, 0] == pytest.approx(1.0)
    batch["next", "terminated"] = torch.zeros_like(batch["next", "terminated"])
    judge(learner, batch)
    assert batch["value_target"][0, 1, 0] == pytest.approx(1.0 + 0.5 * 4.0)


def test_agents_that_have_ended_teach_the_policy_nothing() -> None:
    weights = []
    for noise in (0.0, 3.0):
        learner = poca(2)
        torch.manual_seed(1)
        batch = experience([[0.0, 0.5, 0.0], [0.0, 0.0, 1.0]], lengths=[1, 3])
        batch["observation", "observation"][0, 1:] += noise
        torch.manual_seed(2)
        judge(learner, batch)
        row = learner._learn(batch)
        assert row["loss_critic"] is not None
        weights.append([weight.detach().clone() for weight in learner.actor.parameters()])
    assert all(torch.allclose(one, other, atol=1e-6) for one, other in zip(*weights, strict=True))


def test_teams_that_sit_out_are_in_no_batch() -> None:
    learner = poca(2, CONFIG.model_copy(update={"batch": 2}))  # a team
    batch = experience([[0.0, 0.5, 0.0], [0.0, 0.0, 1.0]], lengths=[3, 3])
    batch["active"][:, :2] = False
    judge(learner, batch)
    row = learner._learn(batch)
    assert learner.updates == 1
    assert np.isfinite(row["loss_objective"])


def test_an_expert_cannot_be_imitated_by_the_critic_of_teams() -> None:
    with pytest.raises(InvalidInputError, match="imitated_steps = 0"):
        poca(1, CONFIG.model_copy(update={"imitated_steps": 8}))


@pytest.mark.parametrize(("embedding", "heads"), [(130, 4), (128, 3), (8, 16)])
def test_heads_that_do_not_share_the_embedding_are_refused(embedding: int, heads: int) -> None:
    with pytest.raises(InvalidInputError, match=f"embedding to be a multiple of heads, {heads}, got {embedding}"):
        poca(2, CONFIG.model_copy(update={"embedding": embedding, "heads": heads}))
