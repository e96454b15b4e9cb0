"""ICM: its losses by the definition, and curiosity that wears off where the learner has been."""

from __future__ import annotations

import copy

import pytest
import torch
from gymnasium.spaces import Box, Dict
from torch import nn

from dohyo.agents.learning.algorithms.icm import Icm, IcmConfig
from dohyo.agents.learning.algorithms.intrinsic import add_intrinsic
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.transitions import ACTIONS, CPU, MOVES, OBSERVATIONS, experience, transitions


def icm(**changes: object) -> Icm:
    torch.manual_seed(0)
    config = IcmConfig(**{"features": 8, "hidden": (32,), "learning_rate": 3e-3, "epochs": 40} | changes)  # type: ignore[arg-type]
    return Icm(OBSERVATIONS, ACTIONS, config, CPU)


def test_curiosity_falls_on_what_was_seen_and_stays_on_what_was_not():
    model, seen = icm(), experience(400)
    unseen = transitions(seen["observation", "observation"] + 4.0, -seen["action"])
    unseen["action"] = seen["action"]  # elsewhere, pushes work the other way round
    before = model.reward(seen).mean()
    model.update(seen)
    assert model.reward(seen).mean() < 0.1 * before
    assert model.reward(unseen).mean() > 10.0 * model.reward(seen).mean()


def test_the_losses_by_hand():
    """phi is the place; the inverse model answers (1, 0), the forward model always the origin."""
    model = icm(features=2, eta=0.5)
    model._phi = _Place()
    for part, answer in ((model._inverse, [1.0, 0.0]), (model._forward, [0.0, 0.0])):
        nn.init.zeros_(part[-1].weight)
        part[-1].bias.data = torch.tensor(answer)
    row = transitions(torch.tensor([[0.3, 0.0]]), torch.tensor([[1.0, 2.0]]))  # to (0.8, 1.0); in [-1, 1]: (0.5, 1)
    inverse, forward = model.losses(row)
    assert inverse.item() == pytest.approx(0.5**2 + 1.0**2)
    assert forward.item() == pytest.approx(0.5 * (0.8**2 + 1.0**2))
    assert model.reward(row).item() == pytest.approx(0.5 * 0.5 * (0.8**2 + 1.0**2))


class _Place(nn.Module):
    def forward(self, observation: dict[str, torch.Tensor]) -> torch.Tensor:
        return observation["observation"]


def test_the_inverse_model_learns_discrete_actions():
    torch.manual_seed(0)
    config = IcmConfig(features=8, hidden=(32,), learning_rate=1e-2, epochs=30)
    model, moves = Icm(OBSERVATIONS, MOVES, config, CPU), torch.randint(4, (400,))
    rows = transitions(torch.rand(400, 2), moves)
    first = model.losses(rows)[0].mean()
    model.update(rows)
    assert model.losses(rows)[0].mean() < 0.2 * first


def test_pictures_need_an_encoder():
    pictures = Dict({"camera": Box(0, 255, (3, 8, 8), "uint8")})
    with pytest.raises(InvalidInputError, match="an encoder for observation 'camera'"):
        Icm(pictures, ACTIONS, IcmConfig(), CPU)


def test_a_restored_one_goes_on_as_the_first():
    first, other = icm(epochs=1), icm(epochs=1)
    first.update(experience(100))
    other.restore(copy.deepcopy(first.state()))
    rows = []
    for model in (first, other):
        torch.manual_seed(5)
        rows.append(model.update(experience(100)))
    assert rows[0] == rows[1]


def test_intrinsic_rewards_add_to_those_of_the_task_where_a_row_acted():
    model, batch = icm(), experience(6)
    batch["next", "reward"] = torch.full((6, 1), 2.0)
    batch["active"] = torch.tensor([True, True, False, True, True, True])
    expected = 2.0 + 2.0 * model.reward(batch) * batch["active"][:, None]
    row = add_intrinsic([model, model], batch.reshape(2, 3))
    assert torch.allclose(batch["next", "reward"], expected), "both judged before one learned"
    assert set(row) == set(Icm.columns)
