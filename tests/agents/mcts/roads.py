"""Straight roads for the kernels: one lane along x, the ego at the origin, boxes that keep their speed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dohyo.agents.planning.prediction import constant_velocity
from dohyo.agents.planning.scene import SENSORS, SceneBuilder
from dohyo.agents.planning.situation import NO_LINE, Situation, situation
from dohyo.agents.planning.warm_up import empty_road
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.sensors.lanes import ATTRIBUTES, POINTS
from dohyo.sumo_networks.world import ActorKind

ROAD_M = 170.0
KINDS = {"car": ActorKind.CAR, "pedestrian": ActorKind.PEDESTRIAN, "static": ActorKind.STATIC}


def observation(
    cars: Sequence[tuple[float, float, float]] = (), *, speed: float = 5.0, kind: str = "car", limit: float = 13.9,
    width: float = 10.0,
) -> Observation:  # fmt: skip
    """An ego in the middle of a straight lane; cars are x, y [m], speed [m/s] along the road."""
    out = empty_road(SENSORS)
    out["ego_state"][3] = speed
    out["objects"][:] = 0.0
    out["objects"][:, 0] = -1.0
    for i, (x, y, pace) in enumerate(cars):
        out["objects"][i] = KINDS[kind], x, y, 0.0, pace, 4.5, 1.8, i
    out["path"][:, 4], out["path"][:, 5] = limit, width
    lanes = out["lanes"]
    lanes[0, 3:5] = width, limit
    lanes[0, ATTRIBUTES::2] = np.linspace(-25.0, 25.0, POINTS)
    return out


def straight(
    cars: Sequence[tuple[float, float, float]] = (), *, kind: str = "car", limit: float = 13.9, width: float = 10.0,
    line: float = NO_LINE,
) -> Situation:  # fmt: skip
    """The same as a situation; `line` is the arc length of a closed line."""
    scene = SceneBuilder().update(observation(cars, kind=kind, limit=limit, width=width))
    return situation(scene, constant_velocity(scene), max_speed=14.0, curve=2.5, braking=2.0)._replace(line=line)
