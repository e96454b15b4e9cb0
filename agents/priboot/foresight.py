"""Foresight: vehicles that the network's waypoints lead into, if these go on as they do, and that braking avoids.

Ours, beside the thesis's rules, which mind who is on the way now: who comes towards an ego that turns across its lane,
and who drives beside an ego that changes lanes. Vehicles on a crossing road are left out, since these usually stop.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dohyo.agents.priboot.recording.dataset import WAYPOINT_S
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.portable_math import arctan2
from dohyo.sumo_networks.world import ActorKind

STEP_S, CIRCLES = 0.25, 5
"""Time between two places that are compared, and circles that cover a vehicle."""
STANDS_M_S, BRAKING = 0.3, 5.0
"""Speed below which another one stands, and deceleration of the ego and of others, m/s^2."""
TOWARDS, CROSSING, BESIDE = -0.5, 0.8, 0.87
"""Cosines of the heading of one that comes towards the ego, of the angle between two ways that cross, and of the
heading of one that drives beside it."""
_VEHICLE = VehicleParameters()
_VEHICLES = (ActorKind.CAR, ActorKind.VAN, ActorKind.TRUCK, ActorKind.BUS, ActorKind.EMERGENCY, ActorKind.EGO)


def must_brake(objects: Float32Array, speed: float, waypoints: FloatArray) -> bool:
    """Whether an ego that follows its waypoints meets a vehicle, and does not where it brakes.

    Args:
        objects: (48, 8) of the sensor of that name.
        speed: Of the ego, m/s.
        waypoints: (4, 2) every half second, m, ego frame.
    """
    there = objects[np.isin(objects[:, 0], _VEHICLES) & (objects[:, 4] > STANDS_M_S)].astype(np.float64)
    towards, beside = np.cos(there[:, 3]) < TOWARDS, _beside(there)
    there, towards = there[towards | beside], towards[towards | beside]
    if not len(there):
        return False
    points = np.vstack([np.zeros(2), waypoints])
    far = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    times = np.arange(0.0, WAYPOINT_S * len(waypoints) + 1e-6, STEP_S)
    goes = np.interp(times, WAYPOINT_S * np.arange(len(points)), far)
    braked = np.minimum(times, speed / BRAKING)
    brakes = np.minimum(speed * braked - BRAKING / 2 * braked**2, goes)
    hit, headings = _overlaps(there, points, far, goes, times)
    crosses = np.abs(np.cos(there[:, 3, None] - headings)) < CROSSING
    hit &= crosses | ~towards[:, None]
    avoided = ~_overlaps(there, points, far, brakes, times)[0].any(axis=1)
    return bool((hit.any(axis=1) & avoided).any())


def _beside(there: FloatArray) -> NDArray[np.bool_]:
    """(N,) who drives in the ego's direction on another lane, beside it or behind."""
    side = np.abs(there[:, 2]) > _VEHICLE.width / 2 + there[:, 6] / 2
    return np.asarray(side & (there[:, 1] < _VEHICLE.length) & (np.cos(there[:, 3]) > BESIDE))


def _overlaps(
    there: FloatArray, points: FloatArray, far: FloatArray, metres: FloatArray, times: FloatArray
) -> tuple[NDArray[np.bool_], FloatArray]:
    """(N, T) whether the ego, so many metres along its waypoints at each time, meets each vehicle; (T,) its heading."""
    behind, at, ahead = (
        np.column_stack([np.interp(metres + by, far, points[:, axis]) for axis in (0, 1)]) for by in (-0.5, 0.0, 0.5)
    )
    ahead -= behind
    moving = np.linalg.norm(ahead, axis=1) > 0.05
    headings = np.where(moving, arctan2(ahead[:, 1], ahead[:, 0]), 0.0)
    size = np.full(len(times), _VEHICLE.length), np.full(len(times), _VEHICLE.width)
    ego, ego_radius = _circles(at, headings, *size)
    driven = there[:, 4, None] * times
    places = there[:, None, 1:3] + driven[..., None] * _along(there[:, 3])[:, None]
    shape = driven.shape
    others, radius = _circles(places, *(np.broadcast_to(there[:, column, None], shape) for column in (3, 5, 6)))
    apart = np.linalg.norm(ego[None, :, :, None] - others[:, :, None], axis=-1)
    return apart.min(axis=(2, 3)) < ego_radius + radius, headings


def _circles(
    at: FloatArray, heading: FloatArray, length: FloatArray, width: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(..., 5, 2) centres, and (...) radius, of circles that cover boxes."""
    offsets = (np.arange(CIRCLES) - (CIRCLES - 1) / 2) / CIRCLES
    centres = at[..., None, :] + (length[..., None] * offsets)[..., None] * _along(heading)[..., None, :]
    return centres, np.hypot(length / (2 * CIRCLES), width / 2)


def _along(heading: FloatArray) -> FloatArray:
    return np.stack([np.cos(heading), np.sin(heading)], axis=-1)
