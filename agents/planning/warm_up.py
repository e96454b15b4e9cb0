"""Observation of an empty road. Agents warm up on it, so that numba has compiled their kernels before they drive."""

from __future__ import annotations

from typing import Any

import numpy as np

from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.ego.dynamics import GRAVITY
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.sensors.lanes import ATTRIBUTES, POINTS

LIMIT_M_S, WIDTH_M = 13.9, 3.2


def empty_road(sensors: tuple[str, ...]) -> Observation:
    """A straight lane, and one parked car far ahead beside it. Pictures are black.

    Args:
        sensors: Names of `dohyo.sumo_networks.sensors.SENSORS`, in any order.
    """
    made = make_sensors(sensors)
    out: dict[str, Any] = {sensor.name: np.zeros(sensor.space.shape, dtype=sensor.space.dtype) for sensor in made}
    for name, seen in out.items():
        if name in _FILL:
            _FILL[name](seen)
    return out


def _ego_state(out: Float32Array) -> None:
    out[:] = 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 4.5, 1.8


def _objects(out: Float32Array) -> None:
    out[:, 0] = -1.0
    out[0] = 0.0, 60.0, 4.0, 0.0, 0.0, 4.5, 1.8, 0.0


def _path(out: Float32Array) -> None:
    out[:, 0] = np.arange(len(out)) - 12.0
    out[:, 4:] = LIMIT_M_S, WIDTH_M


def _route(out: Float32Array) -> None:
    out[:, 0] = np.arange(len(out))
    out[:, 4:6] = LIMIT_M_S, WIDTH_M


def _route_map(out: Float32Array) -> None:
    _route(out)
    out[:, 7] = out[:, 0]


def _junctions_ahead(out: Float32Array) -> None:
    out[:, :2], out[:, 2] = 1000.0, -1.0


def _conflicts(out: Float32Array) -> None:
    out[:, :4], out[:, 6] = 1000.0, -1.0


def _lanes(out: Float32Array) -> None:
    out[:, 0] = -1.0
    out[0, :ATTRIBUTES] = 0.0, 0.0, 0.0, WIDTH_M, LIMIT_M_S, 2.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0
    out[0, ATTRIBUTES::2] = np.linspace(-20.0, 20.0, POINTS)


def _fix(out: Float32Array) -> None:
    out[0] = 1.0


def _at_rest(out: Float32Array) -> None:
    out[:, 2] = GRAVITY


_FILL = {
    "ego_state": _ego_state,
    "objects": _objects,
    "path": _path,
    "route": _route,
    "route_map": _route_map,
    "junctions_ahead": _junctions_ahead,
    "conflicts": _conflicts,
    "lanes": _lanes,
    "gnss": _fix,
    "gnss_rtk": _fix,
    "imu": _at_rest,
}
"""Sensors whose zeros would not be a road, or not a standing vehicle."""
