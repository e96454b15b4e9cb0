"""Small stand-ins: an encoder that was never trained, and pictures with something in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file

from dohyo.agents.hierarchical.vision.classes import HEIGHT, WIDTH
from dohyo.agents.hierarchical.vision.dataset import Pictures
from dohyo.agents.hierarchical.vision.network import Encoder
from dohyo.sumo_networks.rendering.labels import Label


def untrained(path: Path, latent: int = 12, seed: int = 0) -> Encoder:
    """Writes an encoder as training does, and returns it."""
    torch.manual_seed(seed)
    network = Encoder(latent).eval()
    tensors = {name: tensor.half().contiguous() for name, tensor in network.state_dict().items()}
    save_file(tensors, path)
    network.load_state_dict({name: tensor.float() for name, tensor in tensors.items()})
    return network


def picture(seed: int) -> np.ndarray:
    """(1, 80, 160) a road with a car and a light somewhere."""
    rng = np.random.default_rng(seed)
    out = np.full((1, HEIGHT, WIDTH), Label.NONE, dtype=np.uint8)
    out[:, 40:] = Label.ROAD
    x, size = int(rng.integers(20, 120)), int(rng.integers(4, 20))
    out[:, 40 : 40 + size, x : x + size] = Label.VEHICLE
    out[:, 10:26, 100:116] = [Label.LIGHT_RED, Label.LIGHT_GREEN][seed % 2]
    return out


def pictures(count: int, seed: int = 0) -> Pictures:
    """A dataset in which the car's size tells how far it is."""
    rows = []
    for number in range(seed, seed + count):
        shown = picture(number)[0]
        size = int((shown == Label.VEHICLE).any(axis=1).sum())
        rows.append((shown, 50.0 - 2.0 * size, 20.0, 1 + 2 * (number % 2), np.zeros(6)))
    return Pictures.of(rows)
