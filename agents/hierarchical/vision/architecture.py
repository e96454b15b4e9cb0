"""Architecture: numbers shared by the network (torch) and the encoder (ONNX)."""

from __future__ import annotations

from dohyo.agents.hierarchical.vision.classes import CLASSES, HEIGHT, WIDTH

FILTERS = (32, 64, 128, 256)
KERNEL, STRIDE = 4, 2
LATENT = 400
HEAD = 64
SIGNALS = 4
"""Columns of the next junction's signal: none, red, yellow, green."""
TOLD = 2 + SIGNALS


def sizes() -> list[tuple[int, int]]:
    """Height and width of a picture, and after each convolution."""
    out = [(HEIGHT, WIDTH)]
    for _ in FILTERS:
        height, width = out[-1]
        out.append(((height - KERNEL) // STRIDE + 1, (width - KERNEL) // STRIDE + 1))
    return out


def features() -> int:
    """Number of outputs of the last convolution."""
    height, width = sizes()[-1]
    return FILTERS[-1] * height * width


def encoder_shapes(latent: int = LATENT) -> dict[str, tuple[int, ...]]:
    """Shapes of the encoder's weights by their names."""
    before = (CLASSES, *FILTERS[:-1])
    shapes: dict[str, tuple[int, ...]] = {}
    for number, (a, b) in enumerate(zip(before, FILTERS, strict=True)):
        shapes |= {f"convolutions.{number}.weight": (b, a, KERNEL, KERNEL), f"convolutions.{number}.bias": (b,)}
    for name, a, b in (("mean", features(), latent), ("head", latent, HEAD), ("told", HEAD, TOLD)):
        shapes |= {f"{name}.weight": (b, a), f"{name}.bias": (b,)}
    return shapes
