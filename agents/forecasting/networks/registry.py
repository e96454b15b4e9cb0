"""Networks by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from dohyo.agents.forecasting.networks.attention import TransformerTrunk, TsMixerTrunk
from dohyo.agents.forecasting.networks.convolution import ConvLstmTrunk, SaConvLstmTrunk
from dohyo.agents.forecasting.networks.looking_ahead import AllAtOnce, NStep, Recursive, SpeedNetwork, Trunk
from dohyo.agents.forecasting.networks.lstm import LstmTrunk, SaLstmTrunk
from dohyo.sumo_networks.errors import UnknownNameError

NETWORKS: Mapping[str, tuple[type[Recursive] | type[AllAtOnce] | type[NStep], Trunk]] = MappingProxyType(
    {
        "lstm": (Recursive, LstmTrunk),
        "convlstm": (Recursive, ConvLstmTrunk),
        "sa-convlstm": (Recursive, SaConvLstmTrunk),
        "transformer": (Recursive, TransformerTrunk),
        "sa-lstm": (Recursive, SaLstmTrunk),
        "sa-lstm-all-at-once": (AllAtOnce, SaLstmTrunk),
        "sa-lstm-n-step": (NStep, SaLstmTrunk),
        "tsmixer": (AllAtOnce, TsMixerTrunk),
    }
)


def make_network(name: str, segments: int) -> SpeedNetwork:
    """An untrained network.

    Raises:
        UnknownNameError: There is no such network.
    """
    if name not in NETWORKS:
        raise UnknownNameError("network", name, NETWORKS)
    way, trunk = NETWORKS[name]
    return way(trunk, segments)
