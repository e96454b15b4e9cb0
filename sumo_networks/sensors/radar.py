"""Radar: nine rays ahead, each up to the first body."""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from gymnasium.spaces import Box
from numba import njit

from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.geometry import ray_to_box
from dohyo.sumo_networks.sensors.base import Sensor, Track
from dohyo.sumo_networks.world import ActorKind, World

RANGE_M = 80.0
ANGLES = np.radians(np.arange(60.0, -61.0, -15.0))
REFERENCE_M = 20.0


class Radar(Sensor):
    """(9, 3) one row per ray from the middle of the front bumper, at 60, 45, ... -60 degrees (left to right).

    Columns: distance to the first body [m, at most 80], its kind (`world.ActorKind`, -1 if there is none), and its
    relative speed along the ray [m/s, negative: approaching]. Bodies are the boxes of actors: kerbs and houses return
    nothing. Conditions add noise that grows with the distance, noise of the speed, and rays that return nothing; fog
    does not shorten the range.

    Source: the rays of Albilani's parking agent (60 degrees to either side, 15 apart, 80 m); the speed is ours.
    """

    name = "radar"
    track = Track.SENSORS
    space = Box(
        np.tile(np.array([0, -1, -200], np.float32), (len(ANGLES), 1)),
        np.tile(np.array([RANGE_M, 20, 200], np.float32), (len(ANGLES), 1)),
    )

    def __init__(self, conditions: Conditions, rng: np.random.Generator) -> None:
        self._conditions, self._rng = conditions, rng

    @classmethod
    def make(cls, conditions: Conditions, rng: np.random.Generator) -> Self:
        """Makes the sensor; see `Sensor`."""
        return cls(conditions, rng)

    def read(self, world: World, ego: int) -> Float32Array:
        """Reads the array; see the class."""
        actors, egos, noise = world.actors, world.egos, self._conditions
        bodies = np.empty((len(actors) + len(egos.names), 7))
        bodies[: len(actors), :5], bodies[: len(actors), 5] = actors.boxes(), actors.speed
        bodies[: len(actors), 6] = actors.kind
        others = bodies[len(actors) :]
        others[:, :2], others[:, 2], others[:, 3], others[:, 4] = egos.position, egos.heading, egos.length, egos.width
        others[:, 5], others[:, 6] = egos.speed, np.where(egos.active, float(ActorKind.EGO), -1.0)
        others[ego, 6] = -1.0
        x, y = egos.position[ego]
        out = _scan(
            float(x), float(y), float(egos.heading[ego]), float(egos.speed[ego]), float(egos.length[ego]), bodies
        )
        if noise.position_noise_m or noise.speed_noise or noise.dropout:
            drawn = self._rng.standard_normal((len(ANGLES), 2))
            met = out[:, 1] >= 0
            missing = (self._rng.random(len(ANGLES)) < noise.dropout) & met
            wrong = out[:, 0] * (1.0 + noise.position_noise_m / REFERENCE_M * drawn[:, 0])
            out[met, 0] = np.clip(wrong, 0.0, RANGE_M)[met]
            out[:, 2] *= 1.0 + noise.speed_noise * drawn[:, 1]
            out[missing] = RANGE_M, -1.0, 0.0
        return out.astype(np.float32)


@njit(cache=True)
def _scan(x: float, y: float, heading: float, speed: float, length: float, bodies: FloatArray) -> FloatArray:
    """Computes the rays of one ego.

    Args:
        x: x of the ego's box centre, m.
        y: y of the ego's box centre, m.
        heading: Heading of the ego, rad.
        speed: Speed of the ego, m/s.
        length: Length of the ego, m.
        bodies: (M, 7) x, y, heading, length, width, speed along the heading, kind (negative: no body).
    """
    out = np.zeros((ANGLES.shape[0], 3))
    cos, sin = math.cos(heading), math.sin(heading)
    front_x, front_y = x + 0.5 * length * cos, y + 0.5 * length * sin
    for ray in range(ANGLES.shape[0]):
        ux, uy = math.cos(heading + ANGLES[ray]), math.sin(heading + ANGLES[ray])
        out[ray, 0], out[ray, 1] = RANGE_M, -1.0
        for i in range(bodies.shape[0]):
            if bodies[i, 6] < 0.0:
                continue
            # The bounding circles of most bodies miss the ray, which saves the trigonometry of the boxes.
            dx, dy = bodies[i, 0] - front_x, bodies[i, 1] - front_y
            reach, along = 0.5 * (bodies[i, 3] + bodies[i, 4]), dx * ux + dy * uy
            if abs(dx * uy - dy * ux) > reach or along < -reach or along - reach > out[ray, 0]:
                continue
            distance = ray_to_box(front_x, front_y, ux, uy, bodies[i, :5])
            if distance < out[ray, 0]:
                theirs = bodies[i, 5] * (math.cos(bodies[i, 2]) * ux + math.sin(bodies[i, 2]) * uy)
                out[ray, 0], out[ray, 1] = distance, bodies[i, 6]
                out[ray, 2] = theirs - speed * (cos * ux + sin * uy)
    return out
