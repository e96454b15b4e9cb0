"""How long encoders and augmentations take on one core, for batches of pictures as pixel learners have them."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import torch

from dohyo.agents.perception.augmentation import colour_jitter, gaussian_blur, random_shift
from dohyo.agents.perception.encoders.registry import make_encoder

ROUNDS = 7
BATCH, SHAPE = 32, (9, 64, 64)


def median_ms(work: Callable[[], object]) -> float:
    """Median over rounds, after one to warm up, ms."""
    work()
    rounds = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        work()
        rounds.append(1e3 * (time.perf_counter() - began))
    return float(np.median(rounds))


def forward_ms(name: str) -> float:
    """An encoder in evaluation."""
    encoder, pictures = make_encoder(name, SHAPE).eval(), _pictures()
    with torch.inference_mode():
        return median_ms(lambda: encoder(pictures))


def mixing_ratio() -> float:
    """An update of RLAD's encoder with A-LIX, over one without."""
    encoder, pictures = make_encoder("rlad", SHAPE), _pictures()

    def update() -> None:
        encoder.zero_grad()
        encoder(pictures).sum().backward()

    mixed = median_ms(update)
    encoder.eval()
    return mixed / median_ms(update)


def augmentations_ms() -> dict[str, float]:
    """Each augmentation of one batch of bytes."""
    pictures, generator = _pictures(), torch.Generator().manual_seed(0)
    return {
        "random shift": median_ms(lambda: random_shift(pictures, generator, pad=4)),
        "colour jitter": median_ms(
            lambda: colour_jitter(pictures, generator, brightness=0.3, contrast=0.3, saturation=0.3, hue=0.05)
        ),
        "Gaussian blur": median_ms(lambda: gaussian_blur(pictures, generator)),
    }


def _pictures() -> torch.Tensor:
    torch.set_num_threads(1)
    return torch.randint(0, 256, (BATCH, *SHAPE), dtype=torch.uint8)
