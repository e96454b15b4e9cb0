"""Divergence: a policy without finite actions ends its training, and says so."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from dohyo.agents.learning.algorithms.ddpg import Ddpg, DdpgConfig
from dohyo.agents.learning.algorithms.divergence import check_actions
from dohyo.agents.learning.algorithms.ppo import Ppo
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig
from dohyo.agents.learning.algorithms.sac import Sac, SacConfig
from dohyo.agents.learning.experience.collector import Collector
from dohyo.sumo_networks.errors import DohyoError
from tests.agents.learning.learners import learner
from tests.agents.learning.problems import Point

SAID = r"the training has diverged: expected finite actions, got \[nan.*\]; .* is [\d.]+, in 'observation'; it goes on"


def made(kind: Any, folder: Path) -> Any:
    if kind is Ppo:
        collector = Collector(Point().make_environments(2, processes=False), Point(), seed=0)
        return Ppo(Point(), collector, PpoConfig(horizon=4, batch=4), torch.device("cpu"))
    config: Any = {Sac: SacConfig, Ddpg: DdpgConfig}[kind]
    return learner(kind, config(learning_starts=0, round_steps=4, batch=4), Point(), folder)


@pytest.mark.parametrize("kind", [Sac, Ddpg, Ppo])
def test_a_policy_without_finite_actions_ends_the_round_and_an_evaluation(kind: Any, tmp_path: Path) -> None:
    found = made(kind, tmp_path)
    with torch.no_grad():
        for weight in (found.actor.body if kind is Ppo else found.actor).parameters():
            weight.fill_(torch.nan)
    with pytest.raises(DohyoError, match=SAID):
        found.round()
    with pytest.raises(DohyoError, match=SAID):
        found.act(TensorDict({"observation": torch.tensor([[0.5, 0.25]])}, [1]))


def test_ppo_ends_where_its_losses_are_not_finite(tmp_path: Path) -> None:
    found = made(Ppo, tmp_path)
    with torch.no_grad():
        for weight in found._value.body.parameters():
            weight.fill_(torch.nan)
    with pytest.raises(DohyoError, match="the training has diverged: loss_objective, loss_critic"):
        found.round()


def test_the_largest_observation_is_told() -> None:
    seen = TensorDict(
        {"far": torch.tensor([[1.0], [-3e30]]), "picture": torch.full((2, 1, 2, 2), 255, dtype=torch.uint8)}, [2]
    )
    check_actions(np.zeros((2, 1), np.float32), seen)
    check_actions(np.zeros(2, np.int64), seen)
    with pytest.raises(DohyoError, match=r"got \[inf\]; the largest number of the observations is 3e\+30, in 'far'"):
        check_actions(np.array([[0.0], [np.inf]], np.float32), seen)
