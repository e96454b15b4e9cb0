"""RLAD and its rivals: which loss moves what, on pictures drawn at random."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDict

from dohyo.agents.endless_driving.config import TownConfig
from dohyo.agents.endless_driving.environment import LIGHT
from dohyo.agents.endless_driving.latent import SLIM, Latent, LatentConfig
from dohyo.agents.endless_driving.observation import PICTURE
from dohyo.agents.endless_driving.task import EndlessDriving
from dohyo.agents.learning.algorithms.sac import Sac
from dohyo.agents.perception.encoders.rlad import RladEncoder
from dohyo.agents.rlad.light_loss import LightLoss
from dohyo.agents.rlad.training import RladConfig
from tests.agents.learning.learners import learner, transitions

TASK = EndlessDriving(TownConfig())
SMALL = RladConfig(hidden=(16,), batch=12)


def batch(count: int = 12) -> TensorDict:
    """Transitions whose light shows in the picture."""
    found = transitions(TASK, count)
    for moment in ((), ("next",)):
        light = torch.randint(3, (count, 1))
        picture = torch.randint(40, 80, (count, 9, 64, 64))
        for number in range(count):
            if light[number]:
                picture[number, int(light[number]) - 1 :: 3, 8:16, 28:36] = 255
        found[(*moment, "observation", LIGHT)] = light.float()
        found[(*moment, "observation", PICTURE)] = picture.to(torch.uint8)
    return found


def made(folder: Path, kind: Any = Sac, auxiliary: Any = None, config: Any = SMALL, **options: Any) -> Any:
    torch.manual_seed(0)
    latent = Latent(TASK.observation_space, LatentConfig())
    given = {"auxiliary": [auxiliary(latent)]} if auxiliary else {}
    return learner(kind, config, TASK, folder, encoder=latent, **given, **options)


def copied(module: torch.nn.Module) -> dict[str, torch.Tensor]:
    return {name: value.clone() for name, value in module.state_dict().items()}


def moved(module: torch.nn.Module, before: dict[str, torch.Tensor]) -> set[str]:
    return {name for name, value in module.state_dict().items() if not torch.equal(value, before[name])}


def test_the_encoder_has_the_size_that_the_readme_says() -> None:
    encoder = RladEncoder((9, 64, 64), layers=SLIM)
    assert sum(one.numel() for one in encoder.parameters()) == 334_209
    thesis = RladEncoder((9, 256, 256))
    assert sum(one.numel() for one in thesis.parameters()) == 634_625


def test_the_actors_loss_moves_no_encoder(tmp_path: Path) -> None:
    """Where the critics are right already, only the actor has something to learn."""
    sac, seen = made(tmp_path), batch()
    sac.encoder.eval()  # without A-LIX, so that features are the same twice
    for layer in (sac.critics, sac.target):
        for one in layer.parameters():
            one.data[1] = one.data[0]
    with torch.no_grad():
        right = sac.critics(sac.encoder(seen["observation"]), sac._unit(seen["action"]))[0]
    actor, encoder = copied(sac.actor), copied(sac.encoder)
    sac.learn_towards(seen, right)
    assert moved(sac.actor, actor)
    assert not moved(sac.encoder, encoder)
    sac.learn_towards(seen, right + 1.0)
    assert any(name.startswith("seen.convolutions") for name in moved(sac.encoder, encoder))
    assert any(name.startswith("ahead") for name in moved(sac.encoder, encoder))


def test_the_lights_loss_moves_the_pictures_encoder_alone_and_learns(tmp_path: Path) -> None:
    sac, seen = made(tmp_path, auxiliary=LightLoss), batch()
    (loss,) = sac._auxiliary
    loss(seen, sac.encoder(seen["observation"])).backward()
    for name, parameter in sac.encoder.named_parameters():
        moves = parameter.grad is not None and bool(parameter.grad.abs().sum() > 0.0)
        assert moves == name.startswith("seen."), name
    optimizer, losses = torch.optim.Adam([*sac.encoder.parameters(), *loss.parameters()], 1e-3), []
    for _ in range(25):
        optimizer.zero_grad()
        losses.append(loss(seen, sac.encoder(seen["observation"])))
        losses[-1].backward()
        optimizer.step()
    assert losses[-1] < 0.5 * losses[0]


def test_a_single_encoder_is_in_a_checkpoint_and_none_follows_it(tmp_path: Path) -> None:
    sac = made(tmp_path, auxiliary=LightLoss)
    holders = [name for name, part in sac.parts.items() if any("convolutions" in key for key in part.state_dict())]
    assert holders == ["encoder"]
