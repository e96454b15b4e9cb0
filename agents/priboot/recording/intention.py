"""Intention: the waypoints that an expert asks for while its ego is held back, and so cannot drive.

The ego is moved on for two seconds as the model of its car moves under the pedal and the steering that the expert asks
for now. Such a label knows nothing of what comes later, such as a light that will change.

Source: ours; the idea of asking an expert where another drives is that of DAgger (Ross et al. 2011).
"""

from __future__ import annotations

import numpy as np

from dohyo.agents.planning.motion import DT, body, limited_steering, vehicle_step
from dohyo.agents.priboot.recording.dataset import WAYPOINT_S, WAYPOINTS
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters

LATERAL_LIMIT = 6.0
"""Highest lateral acceleration of the model, m/s^2."""
_CAR = body(VehicleParameters(), LATERAL_LIMIT)


def intended(action: FloatArray, speed: float) -> FloatArray:
    """(4, 2) waypoints in the ego's frame, m.

    Args:
        action: (2,) acceleration [m/s^2] and steering [of full lock] of the expert, both kept for two seconds.
        speed: m/s.
    """
    x, y, heading, wheel, acceleration = -_CAR.axle, 0.0, 0.0, 0.0, 0.0
    asked, out = float(action[1]) * _CAR.max_steering, []
    for step in range(1, round(WAYPOINTS * WAYPOINT_S / DT) + 1):
        demand = limited_steering(_CAR, speed, asked)
        x, y, heading, speed, acceleration, wheel = vehicle_step(
            _CAR, x, y, heading, speed, acceleration, wheel, float(action[0]), demand
        )
        if step % round(WAYPOINT_S / DT) == 0:
            out.append((x + _CAR.axle * np.cos(heading), y + _CAR.axle * np.sin(heading)))
    return np.array(out)
