"""Registry: encoders of pictures by name, for configurations."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

from dohyo.agents.perception.encoders.base import Encoder, Shape
from dohyo.agents.perception.encoders.efficientnet import EfficientNetLite0
from dohyo.agents.perception.encoders.impala import ImpalaEncoder
from dohyo.agents.perception.encoders.rlad import RladEncoder
from dohyo.sumo_networks.errors import UnknownNameError

ENCODERS: MappingProxyType[str, Callable[[Shape], Encoder]] = MappingProxyType(
    {"impala": ImpalaEncoder, "rlad": RladEncoder, "efficientnet-lite0": EfficientNetLite0}
)


def make_encoder(name: str, shape: Shape) -> Encoder:
    """An encoder with its default number of features.

    Args:
        name: See `ENCODERS`.
        shape: Of a picture, (C, H, W).

    Raises:
        UnknownNameError: No such encoder.
        InvalidInputError: The encoder cannot read such pictures.
        WeightsMissingError: The package with its weights is not installed.
    """
    if name not in ENCODERS:
        raise UnknownNameError("encoder", name, ENCODERS)
    return ENCODERS[name](shape)
