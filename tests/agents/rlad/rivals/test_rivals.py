"""Rivals of RLAD, each by what makes it itself."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from dohyo.agents.endless_driving.observation import PICTURE
from dohyo.agents.learning.algorithms.sac import Sac
from dohyo.agents.learning.files.report import no_report
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.perception.augmentation import of_transitions
from dohyo.agents.rlad.rivals.curl import POSITIVE, Contrast, two_views
from dohyo.agents.rlad.rivals.drq import VIEWS, Drq
from dohyo.agents.rlad.rivals.drq_v2 import DrqV2, DrqV2Config
from dohyo.agents.rlad.rivals.sac_ae import Reconstruction
from dohyo.agents.rlad.training import RLAD, RladRunConfig
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.rlad.test_rlad import batch, copied, made, moved


def test_the_autoencoder_learns_the_picture_through_the_encoder(tmp_path: Path) -> None:
    sac, seen = made(tmp_path, auxiliary=Reconstruction), batch()
    (loss,) = sac._auxiliary
    assert loss.decoder(torch.zeros(1, 256)).shape == (1, 9, 64, 64)
    loss(seen, sac.encoder(seen["observation"])).backward()
    assert all(one.grad.abs().sum() > 0.0 for one in sac.encoder.seen.convolutions.parameters())
    losses = [float(sac.learn(seen)["loss_reconstruction"]) for _ in range(15)]
    assert losses[-1] < 0.7 * losses[0]


def test_the_keys_follow_slowly_and_views_of_one_picture_are_found(tmp_path: Path) -> None:
    sac, seen = made(tmp_path, auxiliary=Contrast), batch()
    shifted = two_views(of_transitions(lambda pictures, _: pictures.roll(1, dims=-1), [PICTURE]))(seen)
    assert torch.equal(shifted[POSITIVE], seen["observation", PICTURE].roll(1, dims=-1))
    (loss,) = sac._auxiliary
    keys = copied(loss.keys)
    losses = [float(sac.learn(shifted)["loss_contrast"]) for _ in range(15)]
    assert losses[-1] < losses[0]
    assert moved(loss.keys, keys)
    online, name = sac.encoder.seen.state_dict(), "linear.0.weight"
    followed = (loss.keys.state_dict()[name] - keys[name]).norm()
    assert 0.0 < followed < (online[name] - keys[name]).norm()
    assert all(one.grad is None for one in loss.keys.parameters())


def test_drq_learns_towards_the_mean_over_its_views(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    values = iter((1.0, 4.0))
    found = {}
    drq = made(tmp_path, kind=Drq, augment=of_transitions(lambda pictures, _: pictures.roll(1, dims=-1), [PICTURE]))
    monkeypatch.setattr(Drq, "target_values", lambda self, seen, alpha: torch.full((len(seen),), next(values)))
    monkeypatch.setattr(Sac, "learn_towards", lambda self, seen, targets: found.update(seen=seen, targets=targets))
    seen = batch()
    drq.learn(seen)
    assert len(found["seen"]) == len(found["targets"]) == VIEWS * len(seen)
    assert (found["targets"] == 2.5).all()


def test_drq_v2_explores_less_and_less_and_bounds_the_targets_noise(tmp_path: Path) -> None:
    config = DrqV2Config(hidden=(16,), batch=12, noise_steps=100, noise_clip=0.3)
    rival, seen = made(tmp_path, kind=DrqV2, config=config), batch()
    assert rival.noise == 1.0
    smoothed = rival._smoothed(torch.zeros(500, 2))
    assert float(smoothed.abs().max()) == pytest.approx(0.3)
    bold = torch.full((500, 2), 0.95, requires_grad=True)
    rival._smoothed(bold).sum().backward()
    assert bold.grad is not None
    assert (bold.grad == 1.0).all(), "the bound of the action space lets gradients through"
    rival.steps = 50
    assert rival.noise == pytest.approx(0.55)
    rival.steps = 1000
    assert rival.noise == pytest.approx(0.1)
    encoder = copied(rival.encoder)
    losses = [float(rival.learn(seen)["loss_critic"]) for _ in range(10)]
    assert losses[-1] < losses[0]
    assert moved(rival.encoder, encoder)


@pytest.mark.parametrize("algorithm", ["sac-ae", "curl", "drq", "drq-v2"])
def test_a_rival_of_the_twin_is_refused_before_anything_is_written(tmp_path: Path, algorithm: str) -> None:
    settings = RladRunConfig.model_validate({"algorithm": algorithm, "town": {"view": "state"}})
    with pytest.raises(InvalidInputError, match=rf"'{algorithm}' learns from pictures: expected town.view = 'picture'"):
        RLAD.train(settings, TrainRequest("rlad", tmp_path / "run", False, no_report))
    assert not (tmp_path / "run").exists()
