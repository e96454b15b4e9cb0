"""A predictor alone as planner: follows the predicted ego trajectory."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from dohyo.agents.mcts.predicting import PREDICTORS, make_predictor
from dohyo.agents.planning.scene import SENSORS, SceneBuilder
from dohyo.agents.planning.warm_up import empty_road
from dohyo.evaluation.agent import Agent, AgentSpec, Mission, Observation
from dohyo.evaluation.settings import OneOf
from dohyo.sumo_networks.ego.control import WAYPOINT_COUNT, WAYPOINT_INTERVAL_S
from dohyo.sumo_networks.errors import InvalidInputError

_STRIDE = round(WAYPOINT_INTERVAL_S / 0.1)


class PredictorOnly(Agent):
    """Hands the first 4 s of the predicted ego trajectory to the waypoint control."""

    spec = AgentSpec(name="predictor-only", track="privileged", sensors=SENSORS, control="waypoints")

    def __init__(self, predictor: Annotated[str, OneOf(PREDICTORS)] = "learned") -> None:
        self.predictor = make_predictor(predictor)
        self._name = predictor
        self._builder = SceneBuilder()

    def warm_up(self) -> None:
        """Decides on an empty road."""
        self.act(empty_road(self.spec.sensors))

    def reset(self, mission: Mission, seed: int) -> None:
        """Clears the state of the last episode."""
        self._builder.reset()

    def act(self, observation: Observation) -> np.ndarray:
        """Positions every half second."""
        forecast = self.predictor.predict(self._builder.update(observation))
        if forecast.ego is None:
            raise InvalidInputError(f"predictor '{self._name}' predicts no ego trajectory, so it cannot drive")
        return np.ascontiguousarray(forecast.ego[_STRIDE : _STRIDE * WAYPOINT_COUNT + 1 : _STRIDE, :2])
