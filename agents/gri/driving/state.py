"""What the driver sees, as a vector: itself, its path, the next light, and who is near. All of it is privileged."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from gymnasium.spaces import Box, Dict

from dohyo.agents.gri.driving.target_speed import SENSORS, actor_ahead, line_ahead, road_speed, share_of
from dohyo.agents.learning.policies.policy_agent import SensorEncoder
from dohyo.agents.learning.tasks.task import Array
from dohyo.agents.planning import surroundings
from dohyo.agents.planning.surroundings import boxes_on_path
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.sensors.path import BEHIND

AHEAD_M: Final = (3, 6, 10, 15, 20, 30, 45)
"""Points of the path that are seen."""
NEAREST, SIGHT_M = 5, 40.0
SPEED_M_S, ANGLE_RAD = 10.0, 0.6
"""Scales of speeds and of the front wheels."""
SIZE: Final = 5 + 2 * len(AHEAD_M) + 2 + 6 * NEAREST


class DrivingState(SensorEncoder):
    """(51,) see the module."""

    track = "privileged"
    sensors = ("speedometer", *SENSORS)
    space = Dict({"state": Box(-np.inf, np.inf, (SIZE,), np.float32)})

    def warm_up(self) -> None:
        """See `SensorEncoder`."""
        surroundings.warm_up()

    def encode(self, observation: Observation) -> dict[str, Array]:
        """See `SensorEncoder`."""
        path = observation["path"].astype(np.float64)
        boxes = boxes_on_path(observation["objects"], path)
        speed, angle = observation["speedometer"].tolist()
        here = path[BEHIND]
        lateral = here[0] * math.sin(here[2]) - here[1] * math.cos(here[2])  # of the ego, to the left of the path
        itself = [speed / SPEED_M_S, angle / ANGLE_RAD, lateral, -here[2], road_speed(observation) / SPEED_M_S]
        ahead = path[[BEHIND + metres for metres in AHEAD_M]]
        asides = ahead[:, 1] / np.maximum(ahead[:, 0], 3.0)
        stops = [share_of(line_ahead(observation)), share_of(actor_ahead(observation, boxes))]
        seen = [*itself, *asides, *ahead[:, 2], *stops, *_others(observation, boxes).ravel()]
        return {"state": np.array(seen, np.float32)}


def _others(observation: Observation, boxes: FloatArray) -> FloatArray:
    """(5, 6) the nearest others in the frame of the path: whether there, s, d [40 m], speed and direction."""
    out = np.zeros((NEAREST, 6))
    objects = observation["objects"]
    for row in range(NEAREST):
        middle = (boxes[row, 0] + boxes[row, 1]) / 2, (boxes[row, 2] + boxes[row, 3]) / 2
        if objects[row, 0] < 0 or abs(middle[0]) > SIGHT_M:
            continue
        out[row] = 1.0, middle[0] / SIGHT_M, middle[1] / SIGHT_M, objects[row, 4] / SPEED_M_S, *boxes[row, 4:6]
    return out
