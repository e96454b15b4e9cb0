"""SAC: its losses by hand and against TorchRL's, what they move, and a point brought to rest."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.modules import ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import SACLoss

from dohyo.agents.learning.algorithms.sac import Sac, SacConfig
from dohyo.agents.learning.experience.replay import ReplayConfig
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.learners import learner, transitions
from tests.agents.learning.problems import BEST_RETURN, Dial, Point

SMALL = SacConfig(
    hidden=(32, 32),
    batch=64,
    learning_rate=1e-2,
    initial_alpha=0.1,
    updates_per_step=0.5,
    round_steps=250,
    replay=ReplayConfig(capacity=5000),
)


class _Gaussian(nn.Module):
    def __init__(self, sac: Sac) -> None:
        super().__init__()
        self.head = sac.actor

    def forward(self, seen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        mean, log_std = self.head(seen)
        return mean, log_std.exp()


class _Critic(nn.Module):
    """One of the twins."""

    def __init__(self, sac: Sac, index: int) -> None:
        super().__init__()
        self.parts = nn.ModuleList()
        for layer in sac.critics.body[::2]:
            linear = nn.Linear(*layer.weight.shape[1:])
            linear.weight.data, linear.bias.data = layer.weight[index].T.clone(), layer.bias[index, 0].clone()
            self.parts += [linear, nn.ReLU()]

    def forward(self, seen: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        rows = torch.cat([seen, action], dim=-1)
        for part in self.parts[:-1]:
            rows = part(rows)
        return rows


def test_its_losses_are_those_of_torchrl(tmp_path: Path) -> None:
    task = Point()
    sac = learner(Sac, SMALL, task, tmp_path)
    batch = transitions(task, 60)
    theirs = batch.clone()
    theirs["observation"] = batch["observation", "observation"]
    theirs["next", "observation"] = batch["next", "observation", "observation"]
    theirs["action"] = sac._unit(batch["action"])
    actor = ProbabilisticActor(
        TensorDictModule(_Gaussian(sac), ["observation"], ["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        distribution_kwargs={"tanh_loc": False},
        return_log_prob=True,
    )
    twins = [ValueOperator(_Critic(sac, index), in_keys=["observation", "action"]) for index in range(2)]
    loss = SACLoss(actor, twins, loss_function="l2", alpha_init=0.1, target_entropy=-1.0, deactivate_vmap=True)
    loss.make_value_estimator(gamma=SMALL.gamma)
    torch.manual_seed(5)
    expected = loss(theirs)
    torch.manual_seed(5)
    found = sac.learn(batch)
    names = {"loss_critic": "loss_qvalue", "loss_actor": "loss_actor", "loss_alpha": "loss_alpha", "entropy": "entropy"}
    for ours, name in names.items():
        assert found[ours].item() == pytest.approx(expected[name].item(), rel=1e-4, abs=1e-5), ours


def test_a_target_by_hand(tmp_path: Path) -> None:
    """With critics that always say 2 and 3, a density that is known, and two steps to the next observation."""
    task = Point()
    sac = learner(Sac, SMALL.model_copy(update={"replay": ReplayConfig(steps=2), "gamma": 0.9}), task, tmp_path)
    for parameter in sac.target.parameters():
        parameter.data.zero_()
    sac.target.body[-1].bias.data = torch.tensor([[[2.0]], [[3.0]]])
    for parameter in sac.actor.parameters():
        parameter.data.zero_()  # mean 0, deviation 1
    batch = transitions(task, 6, steps=2)
    torch.manual_seed(3)
    targets = sac.target_values(batch, torch.tensor(0.5))
    torch.manual_seed(3)
    noise = torch.randn(6, 1)[:, 0]
    normal = torch.distributions.Normal(0.0, 1.0).log_prob(noise)
    log_density = normal - torch.log(1.0 - torch.tanh(noise) ** 2)
    goes_on = ~batch["next", "terminated"][:, 0]
    expected = batch["next", "reward"][:, 0] + goes_on * 0.81 * (2.0 - 0.5 * log_density)
    assert torch.allclose(targets, expected, atol=1e-5)


def test_which_loss_moves_what(tmp_path: Path) -> None:
    sac = learner(Sac, SMALL, Point(), tmp_path)
    batch = transitions(Point(), 9)
    features = torch.randn(9, 2, requires_grad=True)
    loss, _ = sac.actor_loss(features.detach(), torch.tensor(0.1), batch)
    loss.backward()
    assert all(parameter.grad is None for parameter in sac.critics.parameters())
    assert all(parameter.grad is not None for parameter in sac.actor.parameters())
    assert features.grad is None
    before = [parameter.clone() for parameter in sac.target.parameters()]
    sac.learn(batch)
    for old, target, online in zip(before, sac.target.parameters(), sac.critics.parameters(), strict=True):
        assert torch.allclose(target, old + SMALL.tau * (online - old), atol=1e-7)


def test_it_brings_a_point_to_rest(tmp_path: Path) -> None:
    sac = learner(Sac, SMALL, Point(), tmp_path)
    rows = [sac.round() for _ in range(3)]
    assert rows[-1]["return"] > 2.0 * BEST_RETURN
    assert rows[0]["return"] < 4.0 * BEST_RETURN


def test_discrete_actions_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="Sac: expected actions in a Box"):
        learner(Sac, SMALL, Dial(), tmp_path)
