"""GAIL: its reward by the definition, and a discriminator that separates two drivers."""

from __future__ import annotations

import copy
import math

import pytest
import torch

from dohyo.agents.learning.algorithms.icm import Icm, IcmConfig
from dohyo.agents.learning.algorithms.ppo import Ppo
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.demonstrations import record_demonstrations
from dohyo.agents.learning.imitation.gail import Gail, GailConfig
from dohyo.agents.learning.tasks.task import named
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.problems import Point
from tests.agents.learning.transitions import ACTIONS, CPU, OBSERVATIONS, experience, homeward


def gail(**changes: object) -> Gail:
    torch.manual_seed(0)
    config = GailConfig(
        **{"hidden": (32, 32), "learning_rate": 3e-3, "updates": 100, "gradient_penalty": 0.5} | changes
    )  # type: ignore[arg-type]
    return Gail(homeward(400), OBSERVATIONS, ACTIONS, config, CPU)


@pytest.mark.parametrize("sees", ["action", "next"])
def test_the_reward_rises_for_transitions_like_the_experts_and_falls_for_others(sees):
    model = gail(sees=sees)
    before = model.reward(homeward(200, seed=7)).mean()
    row = model.update(experience(400))
    like, unlike = model.reward(homeward(200, seed=7)).mean(), model.reward(experience(200, seed=7)).mean()
    assert like > before > unlike
    assert row["gail_expert"] > 0.6 > 0.4 > row["gail_policy"]


def test_the_reward_is_minus_the_logarithm_of_one_minus_d():
    model = gail(strength=0.5)
    for logit, expected in ((0.0, 0.5 * math.log(2.0)), (math.log(3.0), -0.5 * math.log(0.25)), (200.0, 100.0)):
        last = model._logit[-1]
        torch.nn.init.zeros_(last.weight)
        torch.nn.init.constant_(last.bias, logit)
        reward = model.reward(experience(3))
        assert reward.shape == (3, 1)
        assert reward.flatten().tolist() == pytest.approx([expected] * 3, rel=1e-5)


def test_an_undecided_discriminator_has_a_loss_of_two_logarithms_of_two():
    """E_expert[-log D] + E_policy[-log(1 - D)] at D = 1/2."""
    model = gail(gradient_penalty=0.0, updates=1)
    torch.nn.init.zeros_(model._logit[-1].weight)
    torch.nn.init.zeros_(model._logit[-1].bias)
    assert model.update(experience(50))["gail_loss"] == pytest.approx(2.0 * math.log(2.0), rel=1e-5)


def test_from_observations_alone_it_reads_no_action():
    model, demonstrations = gail(sees="next"), homeward(20)
    del demonstrations["action"]
    assert model.reward(demonstrations).shape == (20, 1)


def test_a_restored_one_goes_on_as_the_first():
    first, other = gail(updates=3), gail(updates=3)
    first.update(experience(100))
    other.restore(copy.deepcopy(first.state()))
    rows = []
    for model in (first, other):
        torch.manual_seed(5)
        rows.append(model.update(experience(100)))
    assert rows[0] == rows[1]


def test_without_demonstrations_it_is_refused():
    with pytest.raises(InvalidInputError, match="got none"):
        Gail(homeward(0), OBSERVATIONS, ACTIONS, GailConfig(), CPU)


def test_ppo_learns_from_the_task_and_from_intrinsic_rewards(tmp_path):
    """The parking system's mixture: the task's reward, GAIL without actions, and curiosity."""
    task = Point()
    seen = record_demonstrations(task, tmp_path, 4, expert="steps to the middle").transitions()
    spaces = (named(task.observation_space), task.action_space)

    def learner() -> Ppo:
        torch.manual_seed(0)
        config = GailConfig(sees="next", hidden=(16,), updates=2)
        intrinsic = [Gail(seen, *spaces, config, CPU), Icm(*spaces, IcmConfig(hidden=(16,)), CPU)]
        collector = Collector(task.make_environments(2, processes=False), task, 0)
        return Ppo(task, collector, PpoConfig(horizon=32, hidden=(16,)), CPU, intrinsic=intrinsic)

    ppo, alone = learner(), learner()
    alone._intrinsic = ()
    torch.manual_seed(1)
    row = ppo.round()
    torch.manual_seed(1)
    added = row["gail_reward"] + row["icm_reward"]
    assert row["reward"] == pytest.approx(alone.round()["reward"] + added, rel=1e-4)
    assert set(ppo.columns) > set(Gail.columns) | set(Icm.columns)
    other = learner()
    other.restore(copy.deepcopy(ppo.state()))
    batch = experience(5)
    batch["action"] = torch.zeros(5, 1)
    for one, two in zip(ppo._intrinsic, other._intrinsic, strict=True):
        assert torch.equal(one.reward(batch), two.reward(batch))
