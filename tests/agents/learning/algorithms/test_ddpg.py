"""DDPG: its losses against TorchRL's, its updates against stable-baselines3's, and a point brought to rest."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
import torch
from stable_baselines3 import DDPG
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.modules import ValueOperator
from torchrl.objectives import DDPGLoss

from dohyo.agents.learning.algorithms.ddpg import Ddpg, DdpgConfig
from dohyo.agents.learning.experience.replay import ReplayConfig
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.learners import learner, transitions
from tests.agents.learning.problems import BEST_RETURN, Point

SMALL = DdpgConfig(
    hidden=(32, 32),
    batch=64,
    learning_rate=3e-3,
    updates_per_step=0.5,
    round_steps=250,
    replay=ReplayConfig(capacity=5000),
)


class _Critic(nn.Module):
    def __init__(self, ddpg: Ddpg) -> None:
        super().__init__()
        self.critic = ddpg.critic

    def forward(self, seen: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        value: torch.Tensor = self.critic(seen, action)
        return value[0, :, None]


def test_its_losses_are_those_of_torchrl(tmp_path: Path) -> None:
    ddpg = learner(Ddpg, SMALL, Point(), tmp_path)
    batch = transitions(Point(), 60)
    theirs = batch.clone()
    theirs["observation"] = batch["observation", "observation"]
    theirs["next", "observation"] = batch["next", "observation", "observation"]
    theirs["action"] = ddpg._unit(batch["action"])
    loss = DDPGLoss(
        TensorDictModule(ddpg.actor, ["observation"], ["action"]),
        ValueOperator(_Critic(ddpg), in_keys=["observation", "action"]),
        delay_actor=True,
    )
    loss.make_value_estimator(gamma=SMALL.gamma)
    expected, actor = loss(theirs), deepcopy(ddpg.actor)
    found = ddpg.learn(batch)
    assert found["loss_critic"].item() == pytest.approx(expected["loss_value"].item(), rel=1e-5)
    seen = batch["observation", "observation"]
    moved = -ddpg.critic(seen, actor(seen))[0].mean()
    assert found["loss_actor"].item() == pytest.approx(moved.item(), rel=1e-5), "by the critic that has moved"
    assert moved.item() != pytest.approx(expected["loss_actor"].item(), rel=1e-3)


class _Stored:
    """A replay buffer of stable-baselines3 that always samples the same transitions."""

    def __init__(self, batch: TensorDict, unit: nn.Module) -> None:
        after, seen = batch["next"], batch["observation", "observation"]
        rows = (seen, unit(batch["action"]), after["observation", "observation"], after["terminated"].float())
        self._rows = ReplayBufferSamples(*rows, after["reward"])

    def sample(self, batch: int, env: None) -> Any:
        return self._rows


def test_its_updates_are_those_of_stable_baselines3(tmp_path: Path) -> None:
    ddpg, batch = learner(Ddpg, SMALL, Point(), tmp_path), transitions(Point(), 60)
    theirs = DDPG(
        "MlpPolicy", Point().make_env(0), learning_rate=SMALL.learning_rate, policy_kwargs={"net_arch": [32, 32]}
    )
    actor, critic = theirs.actor.mu, theirs.critic.q_networks[0]
    with torch.no_grad():
        for mine, other in zip(ddpg.actor.parameters(), actor.parameters(), strict=True):
            other.copy_(mine)
        for mine, other in zip(ddpg.critic.parameters(), critic.parameters(), strict=True):
            other.copy_(mine[0].T if mine.ndim == 3 and mine.shape[1] > 1 else mine.reshape(other.shape))
    theirs.actor_target.load_state_dict(theirs.actor.state_dict())
    theirs.critic_target.load_state_dict(theirs.critic.state_dict())
    theirs.set_logger(Logger(None, []))
    theirs.replay_buffer = _Stored(batch, ddpg._unit)
    for _ in range(10):
        ddpg.learn(batch)
    theirs.train(gradient_steps=10, batch_size=60)
    seen = batch["observation", "observation"]
    action = ddpg.actor(seen)
    torch.testing.assert_close(actor(seen), action, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(theirs.critic(seen, action)[0][:, 0], ddpg.critic(seen, action)[0], atol=1e-4, rtol=1e-4)
    target = theirs.actor_target(seen)
    torch.testing.assert_close(target, ddpg.target_actor(seen), atol=1e-5, rtol=1e-4)
    assert (target - action).abs().max() > 1e-3, "the target follows slowly"


def test_a_checkpoint_of_other_parts_is_refused(tmp_path: Path) -> None:
    ddpg = learner(Ddpg, SMALL, Point(), tmp_path)
    state = ddpg.state()
    state["parts"]["optimizer"] = state["parts"].pop("actor_optimizer")
    with pytest.raises(InvalidInputError, match=r"expected .*actor_optimizer, got .*optimizer; train anew"):
        ddpg.restore(state)


def test_its_exploration_stays_in_the_action_space(tmp_path: Path) -> None:
    ddpg = learner(Ddpg, SMALL.model_copy(update={"noise": 3.0}), Point(), tmp_path)
    space, seen = Point.action_space, transitions(Point(), 200)["observation"]
    actions = ddpg.explore(seen)["action"].detach().numpy()
    assert (actions >= space.low).all()
    assert (actions <= space.high).all()
    assert actions.std() > 0.1


def test_it_brings_a_point_to_rest(tmp_path: Path) -> None:
    ddpg = learner(Ddpg, SMALL, Point(), tmp_path)
    rows = [ddpg.round() for _ in range(3)]
    assert rows[-1]["return"] > 2.0 * BEST_RETURN
    assert rows[0]["return"] < 4.0 * BEST_RETURN
