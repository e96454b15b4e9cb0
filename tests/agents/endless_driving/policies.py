"""Policies with weights drawn at random and their cards, as a training of endless driving leaves them."""

from __future__ import annotations

from pathlib import Path

from dohyo.agents.endless_driving.config import TownConfig
from dohyo.agents.endless_driving.latent import Latent, LatentConfig
from dohyo.agents.endless_driving.task import EndlessDriving
from dohyo.agents.learning.algorithms.sac import SacPolicy
from dohyo.agents.learning.files.card import UNKNOWN, Card, weights_of, write_card
from dohyo.agents.learning.networks.modules import GaussianHead
from dohyo.agents.learning.networks.vectors import ActionVector
from dohyo.agents.learning.policies.export import export


def drawn_policy(folder: Path, town: TownConfig, trainer: str = "rlad") -> Path:
    """The best.onnx of a run that has learned nothing."""
    folder.mkdir(parents=True, exist_ok=True)
    task = EndlessDriving(town)
    latent = Latent(task.observation_space, LatentConfig())
    policy = SacPolicy(latent, GaussianHead(latent.features, 2, (16,)), ActionVector(task.action_space))
    export(policy, task.observation_space, folder / "best", {})
    config = {"town": town.model_dump(mode="json")}
    card = Card(
        files=weights_of(folder, "best"), subject=task.name, trainer=trainer, command=f"dohyo train {trainer}",
        commits=UNKNOWN, uncommitted=UNKNOWN, config=config, data_sha256=None, seed=0, steps=0, device="cpu",
        tier=3, metrics={},
    )  # fmt: skip
    write_card(folder, "best", card)
    return folder / "best.onnx"
