"""Observation of an empty road. Planners decide on it when they are created, so that numba is compiled by then."""

from __future__ import annotations

import numpy as np

from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.sensors.lanes import ATTRIBUTES, POINTS


def empty_road(sensors: tuple[str, ...]) -> Observation:
    """A straight lane, and one parked car far ahead beside it.

    Args:
        sensors: Those of `planning.scene.SENSORS`, in any order.
    """
    out = {sensor.name: np.zeros(sensor.space.shape, dtype=np.float32) for sensor in make_sensors(sensors)}
    out["ego_state"][:] = 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 4.5, 1.8
    out["objects"][:, 0] = -1.0
    out["objects"][0] = 0.0, 60.0, 4.0, 0.0, 0.0, 4.5, 1.8, 0.0
    out["path"][:, 0] = np.arange(len(out["path"])) - 12.0
    out["path"][:, 4:] = 13.9, 3.2
    out["junctions_ahead"][:, :2], out["junctions_ahead"][:, 2] = 1000.0, -1.0
    lanes = out["lanes"]
    lanes[:, 0] = -1.0
    lanes[0, :ATTRIBUTES] = 0.0, 0.0, 0.0, 3.2, 13.9, 2.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0
    lanes[0, ATTRIBUTES::2] = np.linspace(-20.0, 20.0, POINTS)
    return out
