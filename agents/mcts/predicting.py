"""Predictors by name, loaded when asked for."""

from __future__ import annotations

import importlib
from types import MappingProxyType

from agents.planning.prediction import Predictor
from sumo_networks.errors import UnknownNameError

PREDICTORS = MappingProxyType(
    {
        "constant_velocity": "agents.mcts.predictors.constant_velocity:ConstantVelocity",
        "idm": "agents.mcts.predictors.idm:IdmRollout",
        "learned": "agents.mcts.predictors.learned:Learned",
    }
)


def make_predictor(name: str) -> Predictor:
    """A predictor by name.

    Raises:
        UnknownNameError: There is none of that name.
    """
    if name not in PREDICTORS:
        raise UnknownNameError("predictor", name, PREDICTORS)
    module, _, kind = PREDICTORS[name].partition(":")
    made: Predictor = getattr(importlib.import_module(module), kind)()
    return made
