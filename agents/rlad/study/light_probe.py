"""Probe: can the small encoder tell the light ahead from 64 x 64 pixels at all, apart from any reinforcement?

    python -m dohyo.agents.rlad.study.light_probe --out agents/rlad/results/light_probe.json     # 80 s of a core

The rules drive through the empty town in all training conditions; encoder and decoder learn the light's class from the
pictures of some episodes, and are judged on those of other episodes.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor, nn

from dohyo.agents.endless_driving.config import ExpertConfig, TownConfig
from dohyo.agents.endless_driving.environment import LIGHT
from dohyo.agents.endless_driving.latent import SLIM
from dohyo.agents.endless_driving.observation import PICTURE
from dohyo.agents.endless_driving.task import EndlessDriving
from dohyo.agents.learning.files.surroundings import surroundings
from dohyo.agents.learning.networks.modules import mlp
from dohyo.agents.perception.encoders.rlad import RladEncoder
from dohyo.agents.rlad.light_loss import CLASSES, HIDDEN
from dohyo.sumo_networks.files import write_atomically

EPISODES, JUDGED, EVERY = 36, 9, 6
"""Episodes to learn from and to be judged on, and decisions from one picture to the next."""
UPDATES, BATCH, LEARNING_RATE = 400, 64, 1e-3
NAMES: Final = ("none", "red or yellow", "green")


def probe() -> dict[str, Any]:
    """Share of right answers by class, %, on pictures of other episodes, and their numbers."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    pictures, classes, episodes = recorded(EPISODES + JUDGED)
    learns = episodes < EPISODES
    encoder = RladEncoder((3, *pictures.shape[2:]), layers=SLIM)
    network = nn.Sequential(encoder, mlp((encoder.features, *HIDDEN, CLASSES)))
    fit(network, pictures[learns], classes[learns])
    network.eval()
    with torch.no_grad():
        right = network(pictures[~learns]).argmax(dim=-1) == classes[~learns]
    found = {name: right[classes[~learns] == number].float() for number, name in enumerate(NAMES)}
    shares = {name: round(100.0 * float(of.mean()), 1) for name, of in found.items()}
    return {
        "right": shares,
        "pictures": {name: len(of) for name, of in found.items()},
        "learned_from": int(learns.sum()),
    }


def recorded(episodes: int) -> tuple[Tensor, Tensor, Tensor]:
    """(N, 3, 64, 64) pictures of the rules' drives, (N,) classes of the light, (N,) numbers of the episodes."""
    env = EndlessDriving(TownConfig(roads="empty", obey_lights=True), ExpertConfig()).make_env(0)
    rows: list[tuple[Any, float, int]] = []
    for episode in range(episodes):
        seen, _ = env.reset(seed=episode)
        over, decision = False, 0
        while not over:
            if decision % EVERY == 0:
                rows.append((seen[PICTURE], float(seen[LIGHT][0]), episode))
            seen, _, terminated, truncated, _ = env.step(env.expert_action())  # type: ignore[attr-defined]
            over, decision = terminated or truncated, decision + 1
    env.close()
    pictures, classes, numbers = zip(*rows, strict=True)
    return torch.from_numpy(np.stack(pictures)), torch.tensor(classes).long(), torch.tensor(numbers)


def fit(network: nn.Module, pictures: Tensor, classes: Tensor) -> None:
    """Cross-entropy on batches in which every class is as frequent as the others."""
    weights = 1.0 / torch.bincount(classes, minlength=CLASSES).clamp(min=1)
    optimizer = torch.optim.Adam(network.parameters(), LEARNING_RATE)
    for _ in range(UPDATES):
        rows = torch.multinomial(weights[classes], BATCH, replacement=True)
        optimizer.zero_grad()
        nn.functional.cross_entropy(network(pictures[rows]), classes[rows]).backward()  # type: ignore[no-untyped-call]
        optimizer.step()


def main() -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="JSON file of the result")
    out = parser.parse_args().out
    document = {**probe(), "origin": surroundings()}
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(out, (json.dumps(document, indent=1) + "\n").encode())
    print(json.dumps({name: value for name, value in document.items() if name != "origin"}))


if __name__ == "__main__":
    main()
