"""PPO: it learns, experts make it faster, and the numbers it learns from."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from tensordict.nn import TensorDictModule
from torch import nn
from torch.distributions import Normal
from torchrl.modules import ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss

from dohyo.agents.learning.algorithms.ppo import Ppo
from dohyo.agents.learning.algorithms.ppo_config import PpoConfig
from dohyo.agents.learning.experience.behaviour import DEMONSTRATOR
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.gymnasium.task import GymnasiumTask
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.learning.tasks.task import Task
from dohyo.agents.perception.encoders.local_mixing import LEARNING_RATE, LocalMixing
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.problems import BEST_RETURN, STEP, Lock, Point, Sign
from tests.agents.learning.toys import LOCK, POINT, SMALL, PointConfig, ToyConfig


def trained(trainer: Trainer, config: ToyConfig, out: Path) -> list[dict[str, str]]:
    """The rows of evaluations.csv."""
    trainer.train(config, TrainRequest("toy", out, False, no_report))
    with (out / "evaluations.csv").open() as file:
        return list(csv.DictReader(file))


def learner(task: Task, **settings: object) -> Ppo:
    torch.manual_seed(0)
    config = PpoConfig(**{"horizon": 64, "hidden": (16, 16), **settings})
    ppo = Ppo(task, Collector(task.make_environments(2, processes=False), task, 0), config, torch.device("cpu"))
    ppo.begin()
    return ppo


def test_it_learns_to_come_to_rest(tmp_path):
    first, *_, last = trained(POINT, PointConfig(steps=4096, evaluate_every=4096), tmp_path / "run")
    assert float(first["return"]) < -15.0
    assert BEST_RETURN >= float(last["return"]) > -2.5
    assert float(last["success"]) == 100.0
    assert float(last["success_low"]) < 60.0  # of four episodes
    assert float(last["length"]) == 20


def test_experts_make_it_faster(tmp_path):
    alone, guided = (
        trained(
            LOCK,
            ToyConfig(steps=2048, evaluate_every=2048, ppo=SMALL.model_copy(update={"guided_share": share})),
            tmp_path / str(share),
        )[-1]
        for share in (0.0, 0.3)
    )
    assert float(alone["success"]) == 0.0
    assert float(guided["success"]) == 100.0


def test_the_share_of_experts_falls(tmp_path):
    config = SMALL.model_copy(update={"guided_share": 0.8, "guided_decay": 0.5})
    trained(LOCK, ToyConfig(steps=1024, evaluate_every=1024, ppo=config), tmp_path / "run")
    with (tmp_path / "run" / "metrics.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["guided_share"]) for row in rows] == [0.8 * 0.5**round_ for round_ in range(8)]
    assert int(rows[0]["guided_steps"]) > 64 > 16 > int(rows[-1]["guided_steps"])
    assert all(float(row["guided_return"]) == 1.0 for row in rows if int(row["guided_episodes"]))


def seen(batch) -> torch.Tensor:
    return batch["observation", "observation"]


def guided_steps(batch) -> int:
    return int((batch["source"] == DEMONSTRATOR).sum())


def test_an_experts_action_is_stored_with_the_policys_density():
    ppo = learner(Point(), guided_share=1.0)
    batch = ppo.collect()
    assert guided_steps(batch) == 2 * 64
    place = seen(batch)[..., 0].numpy()
    assert np.abs(place[:, 0]).tolist() == [1.0, 1.0]
    assert batch["action"][..., 0].numpy() == pytest.approx(np.clip(-place / STEP, -1, 1), abs=1e-6)
    with torch.no_grad():
        mean, std = ppo.actor.gaussian(seen(batch))
    density = Normal(mean, std).log_prob(batch["action"]).sum(-1)
    assert batch["action_log_prob"].numpy() == pytest.approx(density.numpy(), abs=1e-5)


def test_where_an_expert_has_no_opinion_the_policy_acts():
    batch = learner(Point(reticent=True), guided_share=1.0, initial_std=0.1, horizon=256).collect()
    place, action = seen(batch)[..., 0].numpy(), batch["action"][..., 0].numpy()
    advised = np.abs(action - np.clip(-place / STEP, -1, 1)) < 1e-6
    assert (advised == (place < 0)).all()
    assert guided_steps(batch) == advised.sum() > 20
    assert (~advised).sum() > 20


def test_without_experts_the_actions_spread_as_they_should():
    batch = learner(Point(), initial_std=0.7, horizon=1000).collect()
    assert guided_steps(batch) == 0
    assert float(batch["action"].std()) == pytest.approx(0.7, rel=0.07)
    moved = (batch["next", "observation", "observation"] - seen(batch))[..., 0]
    assert moved.numpy() == pytest.approx(STEP * batch["action"][..., 0].clamp(-1, 1), abs=1e-5)


def test_advantages_are_those_of_the_definition():
    """An episode that is cut off still counts what would have come; one that ends does not."""
    for task in (Point(), Lock()):
        ppo = learner(task, gamma=0.9, gae_lambda=0.8)
        batch = ppo.collect()
        with torch.no_grad():
            value = ppo._value(seen(batch))
            after = ppo._value(batch["next", "observation", "observation"])
        reward, done, terminated = (batch["next", name] for name in ("reward", "done", "terminated"))
        assert terminated.any() == isinstance(task, Lock)
        assert done.any()
        delta = reward + 0.9 * after * ~terminated - value
        expected, carried = torch.zeros_like(delta), torch.zeros(2, 1)
        for time in reversed(range(64)):
            carried = delta[:, time] + 0.9 * 0.8 * carried * ~done[:, time]
            expected[:, time] = carried
        assert batch["advantage"].numpy() == pytest.approx(expected.numpy(), abs=1e-5)


@pytest.mark.parametrize("squashed", [False, True])
def test_losses_are_torchrls(squashed):
    ppo = learner(Lock(), squashed=squashed, entropy=0.0, clip=0.1, value_scale=0.7, epochs=2, learning_rate=1e-2)
    data = ppo.collect().reshape(-1)
    ppo._learn(data[:, None])  # so that the ratio is not 1
    policy = ProbabilisticActor(
        TensorDictModule(ppo.actor.parameters_at, in_keys=[("observation", "observation")], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=ppo.actor.distribution,
    )
    critic = ValueOperator(ppo._value, in_keys=[("observation", "observation")])
    theirs = ClipPPOLoss(policy, critic, clip_epsilon=0.1, entropy_bonus=False, critic_coeff=0.7)(data)
    names = ("action", "action_log_prob", "advantage", "value_target")
    ours = ppo._losses({"observation": seen(data)}, *(data[name] for name in names))
    for name in ("loss_objective", "loss_critic", "kl_approx", "clip_fraction"):
        assert ours[name].item() == pytest.approx(theirs[name].item(), rel=1e-5, abs=1e-7), name


def test_a_round_counts_updates_and_lowers_the_learning_rate():
    ppo = learner(Point(), horizon=50, batch=32, epochs=3, learning_rate=1e-3, learning_rate_decay=0.5)
    rows = [ppo.round(), ppo.round()]
    assert [row["updates"] for row in rows] == [3 * math.ceil(2 * 50 / 32), 24]
    assert [row["learning_rate"] for row in rows] == [1e-3, 5e-4]
    assert set(rows[0]) <= set(ppo.columns)
    assert all(math.isfinite(value) for value in rows[0].values() if value is not None)


def test_a_single_transition_left_over_does_no_harm():
    row = learner(Point(), horizon=33, batch=65).round()
    assert math.isfinite(row["loss_objective"])


def test_a_squashed_policy_learns_too():
    ppo = learner(Lock(), squashed=True, guided_share=0.3, learning_rate=3e-3, hidden=(32, 32), entropy=0.0)
    rows = [ppo.round() for _ in range(25)]
    assert rows[0]["success"] == 0.0
    assert rows[-1]["success"] > 30.0
    steps = ppo.collect()
    assert steps["action"].abs().max() <= 1.0
    assert np.abs(ppo.act(steps["observation"][:, 0])).max() <= 1.0


class Pixels(nn.Module):
    """A picture and a number as features."""

    features = 17

    def forward(self, observation: Mapping[str, torch.Tensor]) -> torch.Tensor:
        picture = observation["camera"].flatten(start_dim=-3).float() / 255.0
        return torch.cat([picture, observation["meaning"]], dim=-1)


def test_choices_are_learned_from_pictures_and_numbers():
    torch.manual_seed(0)
    task = Sign()
    collector = Collector(task.make_environments(4, processes=False), task, 0)
    config = PpoConfig(horizon=128, hidden=(32,), learning_rate=1e-2, batch=64, epochs=8, entropy=0.0, gamma=0.0)
    ppo = Ppo(task, collector, config, torch.device("cpu"), encoder=Pixels())
    rows = [ppo.round() for _ in range(8)]
    assert rows[0]["return"] < 7.0
    assert rows[-1]["return"] > 9.0
    assert ppo.act(collector.seen).dtype == np.int64


class Mixed(Pixels):
    """The same, with a picture that A-LIX shifts; it notes whether it was in training."""

    def __init__(self) -> None:
        super().__init__()
        self.mixing = LocalMixing(strength=0.5)
        self.trained = set[tuple[bool, bool]]()

    def forward(self, observation: Mapping[str, torch.Tensor]) -> torch.Tensor:
        self.trained.add((self.training, torch.is_grad_enabled()))
        picture = observation["camera"].float()
        mixed = self.mixing(picture.flatten(end_dim=-4).requires_grad_(), tune=True).reshape(picture.shape)
        return super().forward(dict(observation) | {"camera": mixed})


def test_an_encoder_acts_in_evaluation_and_a_lix_has_its_own_rate():
    task, encoder = Sign(), Mixed()
    collector = Collector(task.make_environments(2, processes=False), task, 0)
    config = PpoConfig(horizon=20, hidden=(8,), learning_rate=1e-5, batch=40, epochs=1)
    ppo = Ppo(task, collector, config, torch.device("cpu"), encoder=encoder)
    ppo.round()
    ppo.act(collector.seen)
    assert encoder.trained == {(False, False), (True, True)}
    assert abs(encoder.mixing.strength.item() - 0.5) == pytest.approx(LEARNING_RATE, rel=1e-3)


class Picture(Point):
    observation_space = Box(0, 255, (3, 8, 8), np.uint8)


def test_pictures_need_an_encoder():
    with pytest.raises(InvalidInputError, match="expected an encoder for observation 'observation'"):
        learner(Picture())


@pytest.mark.parametrize("asked", [{"guided_share": 0.5}, {"imitated_steps": 60}])
def test_a_task_without_an_expert_cannot_be_guided(asked):
    with pytest.raises(InvalidInputError, match="'Pendulum-v1' has no expert; expected guided_share and"):
        learner(GymnasiumTask("Pendulum-v1"), **asked)


def test_squashed_actions_need_bounds_of_one():
    with pytest.raises(InvalidInputError, match=r"expected actions in \[-1, 1\] for a squashed policy"):
        learner(Point(), squashed=True)


def test_what_is_known_of_a_lost_simulation_is_the_step_before_it():
    ppo = learner(Point(fragile="crash"))
    batch = ppo.collect()
    lost = ~batch["active"]
    assert lost.any()
    before = torch.zeros_like(lost)
    before[:, :-1] = lost[:, 1:]
    some = batch[before & ~lost]
    value = ppo._value(ppo._features(some["next", "observation"]))
    expected = some["next", "reward"] + ppo._config.gamma * value
    torch.testing.assert_close(some["value_target"], expected)
