"""Predictors by name, loaded on demand."""

from __future__ import annotations

import importlib
from types import MappingProxyType

from dohyo.agents.planning.prediction import Predictor
from dohyo.sumo_networks.errors import UnknownNameError

PREDICTORS = MappingProxyType(
    {
        "constant_velocity": "dohyo.agents.mcts.predictors.constant_velocity:ConstantVelocity",
        "idm": "dohyo.agents.mcts.predictors.idm:IdmRollout",
        "learned": "dohyo.agents.mcts.predictors.learned:Learned",
    }
)


def make_predictor(name: str) -> Predictor:
    """A predictor by name.

    Raises:
        UnknownNameError: There is no such predictor.
    """
    if name not in PREDICTORS:
        raise UnknownNameError("predictor", name, PREDICTORS)
    module, _, kind = PREDICTORS[name].partition(":")
    made: Predictor = getattr(importlib.import_module(module), kind)()
    return made
