"""Architecture: numbers shared by the network (torch) and the encoder (ONNX)."""

from __future__ import annotations

from dohyo.agents.hierarchical.vision.classes import CLASSES, HEIGHT, WIDTH
from dohyo.agents.perception.convolutions import Convolutions

STACK = Convolutions(CLASSES, HEIGHT, WIDTH, filters=(32, 64, 128, 256), kernel=4, stride=2)
LATENT = 400
HEAD = 64
SIGNALS = 4
"""Columns of the next junction's signal: none, red, yellow, green."""
TOLD = 2 + SIGNALS


def encoder_shapes(latent: int = LATENT) -> dict[str, tuple[int, ...]]:
    """Shapes of the encoder's weights by their names."""
    before, kernel = (CLASSES, *STACK.filters[:-1]), STACK.kernel
    shapes: dict[str, tuple[int, ...]] = {}
    for number, (a, b) in enumerate(zip(before, STACK.filters, strict=True)):
        shapes |= {f"convolutions.{number}.weight": (b, a, kernel, kernel), f"convolutions.{number}.bias": (b,)}
    for name, a, b in (("mean", STACK.outputs, latent), ("head", latent, HEAD), ("told", HEAD, TOLD)):
        shapes |= {f"{name}.weight": (b, a), f"{name}.bias": (b,)}
    return shapes
