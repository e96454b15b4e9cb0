"""Target speed of GRIAD's reward: 40 km/h, falling linearly to 0 towards red lights and whatever is in the way.

Source: Chekroun 2024, section 4.3. Ours: speed limits and curves bound it, too, since 40 km/h does not fit all turns.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from dohyo.agents.planning.surroundings import boxes_on_path
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.rules.red_signal import CLOSED
from dohyo.sumo_networks.sensors.path import BEHIND

FREE_M_S: Final = 40.0 / 3.6
LATERAL_M_S2: Final = 2.5
"""Of curves."""
CURVES_AHEAD_M: Final = 12
STOP_M, FALL_M = 2.0, 20.0
"""The target is 0 at the first distance from a line or an actor, and falls over the second one."""
MARGIN_M: Final = 0.3
"""An actor is in the way if it reaches so close to the strip that the car needs."""
SENSORS: Final = ("path", "objects", "junctions_ahead")
_VEHICLE: Final = VehicleParameters()


def target_speed(observation: Observation) -> float:
    """Speed that is rewarded most, m/s."""
    return road_speed(observation) * min(share_of(line_ahead(observation)), share_of(actor_ahead(observation)))


def road_speed(observation: Observation) -> float:
    """Target speed on a road without lights and others, m/s."""
    ahead = observation["path"][BEHIND : BEHIND + CURVES_AHEAD_M]
    curve = math.sqrt(LATERAL_M_S2 / max(float(np.abs(ahead[:, 3]).max()), 1e-3))
    return min(FREE_M_S, float(ahead[0, 4]), curve)


def share_of(distance: float) -> float:
    """Share of the road's speed at a distance [m] from where to stop."""
    return min(max((distance - STOP_M) / FALL_M, 0.0), 1.0)


def line_ahead(observation: Observation) -> float:
    """Distance from the front to the next stop line whose light is red or yellow, m; infinite without one."""
    return min(
        (float(row[0]) for row in observation["junctions_ahead"] if row[0] >= 0.0 and int(row[2]) in CLOSED),
        default=math.inf,
    )


def actor_ahead(observation: Observation, boxes: FloatArray | None = None) -> float:
    """Distance from the front to the next actor on the path, m; infinite without one.

    Args:
        observation: Of `SENSORS`.
        boxes: Of all actors, see `boxes_on_path`; None: they are computed.
    """
    if boxes is None:
        boxes = boxes_on_path(observation["objects"], observation["path"].astype(np.float64))
    aside = _VEHICLE.width / 2 + MARGIN_M
    there = (observation["objects"][:, 0] >= 0) & (boxes[:, 1] > _VEHICLE.length / 2)
    there &= (boxes[:, 2] < aside) & (boxes[:, 3] > -aside)
    return float((boxes[there, 0] - _VEHICLE.length / 2).min(initial=math.inf))
