"""Encoders and augmentations in an off-policy learner."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import torch

from dohyo.agents.learning.algorithms.iqn import Iqn, IqnConfig
from dohyo.agents.learning.experience.replay import ReplayConfig
from dohyo.agents.learning.networks.modules import ObservationEncoder
from dohyo.agents.perception.augmentation import of_transitions, random_shift
from dohyo.agents.perception.encoders.rlad import RladEncoder
from tests.agents.learning.learners import learner
from tests.agents.learning.problems import Sign

CONFIG = IqnConfig(
    hidden=(32,),
    batch=32,
    gamma=0.0,
    learning_rate=5e-3,
    updates_per_step=0.25,
    exploration_steps=400,
    target_every=20,
    round_steps=100,
    replay=ReplayConfig(capacity=2000),
)


def test_it_learns_from_mixed_and_shifted_pictures_and_acts_on_plain_ones(tmp_path: Path) -> None:
    torch.manual_seed(0)
    camera = RladEncoder((1, 4, 4), features=16, layers=((8, 1),))
    encoder = ObservationEncoder(Sign.observation_space, {"camera": camera})
    augment = of_transitions(partial(random_shift, pad=1), ["camera"])
    iqn = learner(Iqn, CONFIG, Sign(), tmp_path, encoder=encoder, augment=augment)
    before = [parameter.detach().clone() for parameter in camera.parameters()]
    read: set[tuple[int, bool]] = set()
    camera.register_forward_hook(lambda layer, pictures, out: read.add((len(out), layer.training)))
    returns = [iqn.round()["return"] for _ in range(5)]
    assert returns[-1] > 7.0, returns
    assert read == {(32, True), (2, False)}, "batches in training, the two environments in evaluation"
    assert not any(torch.equal(old, new) for old, new in zip(before, camera.parameters(), strict=True))
    groups = iqn._optimizer.param_groups
    assert [(group["lr"], group["betas"]) for group in groups] == [(5e-3, (0.9, 0.999)), (2e-3, (0.5, 0.999))]
