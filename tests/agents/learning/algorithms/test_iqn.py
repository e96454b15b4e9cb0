"""IQN: the quantile Huber loss by hand, quantiles of a known distribution, and a dial turned to its mark."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from torch import nn

from dohyo.agents.learning.algorithms.iqn import Iqn, IqnConfig, quantile_huber
from dohyo.agents.learning.experience.replay import ReplayConfig
from dohyo.agents.learning.networks.modules import DuelingHead, QuantileNetwork
from tests.agents.learning.learners import learner, transitions
from tests.agents.learning.problems import Dial

SMALL = IqnConfig(
    hidden=(32, 32),
    learning_rate=1e-2,
    batch=64,
    updates_per_step=0.25,
    target_every=50,
    exploration_steps=800,
    round_steps=250,
    replay=ReplayConfig(capacity=5000),
)


def test_the_quantile_huber_loss_by_hand() -> None:
    quantiles, levels = torch.tensor([[0.0, 2.0]]), torch.tensor([[0.25, 0.75]])
    targets = torch.tensor([[0.5, 3.0, -1.0]])
    # Errors of the first quantile: 0.5, 3, -1; of the second: -1.5, 1, -3. Huber with kappa 1.
    first = (0.25 * 0.125 + 0.25 * 2.5 + 0.75 * 0.5) / 3
    second = (0.25 * 1.0 + 0.75 * 0.5 + 0.25 * 2.5) / 3
    assert quantile_huber(quantiles, levels, targets, kappa=1.0).item() == pytest.approx(first + second)
    # With kappa 2 the errors of 1.5 are quadratic, 3 is linear: 2 (3 - 1) / 2 = 2.
    first = (0.25 * 0.0625 + 0.25 * 2.0 + 0.75 * 0.25) / 3
    second = (0.25 * 0.5625 + 0.75 * 0.25 + 0.25 * 2.0) / 3
    assert quantile_huber(quantiles, levels, targets, kappa=2.0).item() == pytest.approx(first + second)


def test_it_finds_the_quantiles_of_a_known_distribution() -> None:
    """Of a uniform distribution on [0, 4], whose quantile at level t is 4 t."""
    torch.manual_seed(0)
    network = QuantileNetwork(1, 1, (32, 32))
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-3)
    for _ in range(600):
        levels = torch.rand(32, 8)
        predicted = network(torch.zeros(32, 1), levels)[:, :, 0]
        loss = quantile_huber(predicted, levels, 4.0 * torch.rand(32, 8), kappa=0.1).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    levels = torch.tensor([[0.1, 0.5, 0.9]])
    assert network(torch.zeros(1, 1), levels)[0, :, 0].tolist() == pytest.approx([0.4, 2.0, 3.6], abs=0.25)


@pytest.mark.parametrize("head", [{}, {"dueling": True, "noise": 0.5}])
def test_the_mean_over_levels_is_that_of_the_quantiles(head: dict[str, Any]) -> None:
    network = QuantileNetwork(3, 4, (16, 16), **head).double()
    features, levels = torch.randn(5, 3).double(), torch.rand(7).double()
    assert torch.allclose(network.mean(features, levels), network(features, levels[None]).mean(dim=1))


def test_its_targets_are_the_target_networks_returns_of_its_best_action(tmp_path: Path) -> None:
    iqn = learner(Iqn, SMALL, Dial(), tmp_path)
    for parameter in iqn.target.parameters():
        parameter.data.zero_()
    iqn.target.head.bias.data = torch.tensor([1.0, 5.0, 3.0])
    batch = transitions(Dial(), 6)
    goes_on = ~batch["next", "terminated"]
    expected = batch["next", "reward"] + 0.99 * 5.0 * goes_on
    assert torch.allclose(iqn.target_quantiles(batch), expected.expand(-1, SMALL.target_quantiles))


def test_exploration_falls_linearly(tmp_path: Path) -> None:
    iqn = learner(Iqn, SMALL, Dial(), tmp_path)
    values = {}
    for steps in (0, 400, 800, 5000):
        iqn.steps = steps
        values[steps] = iqn.exploration
    assert values == pytest.approx({0: 1.0, 400: 0.525, 800: 0.05, 5000: 0.05})


def test_a_dueling_head_adds_advantages_of_mean_0_to_the_states_value() -> None:
    head = DuelingHead(3, 4, nn.Linear)
    seen = torch.randn(5, 3)
    values = head(seen)
    assert torch.allclose(values.mean(dim=1), head.value(seen)[:, 0], atol=1e-6)
    assert torch.allclose(values.diff(dim=1), head.advantage(seen).diff(dim=1), atol=1e-6)


def test_the_learned_network_chooses_and_the_target_network_values(tmp_path: Path) -> None:
    iqn = learner(Iqn, SMALL.model_copy(update={"double": True}), Dial(), tmp_path)
    for network, values in ((iqn.target, [1.0, 5.0, 3.0]), (iqn.network, [0.0, 0.0, 9.0])):
        for parameter in network.parameters():
            parameter.data.zero_()
        network.head.bias.data = torch.tensor(values)
    batch = transitions(Dial(), 6)
    expected = batch["next", "reward"] + 0.99 * 3.0 * ~batch["next", "terminated"]
    assert torch.allclose(iqn.target_quantiles(batch), expected.expand(-1, SMALL.target_quantiles))


def test_noise_explores_and_does_not_judge(tmp_path: Path) -> None:
    loud = SMALL.model_copy(update={"noise": 20.0, "first_exploration": 0.0, "last_exploration": 0.0})
    iqn = learner(Iqn, loud, Dial(), tmp_path)
    seen = TensorDict({"observation": torch.eye(3)}, [3])
    assert len({tuple(iqn.explore(seen)["action"].tolist()) for _ in range(20)}) > 1
    assert len({tuple(iqn.act(seen).tolist()) for _ in range(20)}) == 1


@pytest.mark.parametrize(
    "more", [{}, {"double": True, "dueling": True, "noise": 0.1, "replay": ReplayConfig(capacity=5000, priority=0.2)}]
)
def test_it_turns_a_dial_to_its_mark(more: dict[str, Any], tmp_path: Path) -> None:
    iqn = learner(Iqn, SMALL.model_copy(update=more), Dial(), tmp_path)
    rows = [iqn.round() for _ in range(3)]
    assert rows[-1]["return"] > 0.8
    assert rows[0]["return"] < 0.6
