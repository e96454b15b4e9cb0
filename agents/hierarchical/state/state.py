"""State: input of GHRL's policies, one normalised vector per observation with named parts.

    encoder = StateEncoder(StateConfig(vision="none"))
    encoder.reset()
    state = encoder.encode(observation)      # (encoder.size,) float32
    state[encoder.layout["waypoints"]]       # x, y of each waypoint

The parts about the ego and its way (waypoints, deviation, limits, place, motion) are the same with and without
pictures. The part about the others is the latent vector of the last four pictures, or, with `vision="none"`, their
exact state. The second is far cheaper to train; results of the two are not comparable.

Source: Albilani 2023, section 6.2.1: z of an autoencoder of semantic images, waypoints w, localization, speed and
orientation m, lateral distance and angle to the path.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal

import numpy as np
from gymnasium.spaces import Box
from pydantic import Field

from dohyo.agents.hierarchical.environments.allowances import ALLOWANCES, allowances
from dohyo.agents.hierarchical.state import nearby
from dohyo.agents.hierarchical.vision.latents import SHIPPED, Encoder
from dohyo.agents.localization.view import LocalizedView
from dohyo.agents.rules.rules_only import advised_speed
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.ego.dynamics import VehicleParameters

CAMERA = "camera_semantic"
WAYPOINTS_M = (2, 5, 10, 15, 20, 30, 40, 60)
AHEAD_UNIT_M, ASIDE_UNIT_M, DEVIATION_UNIT_M = 30.0, 10.0, 3.0
SPEED_UNIT_M_S, PLACE_UNIT_M = 15.0, 500.0
LIMIT_AHEAD_M, WALKING_M_S = 30, 1.0
BELIEVED = "believed_pose"
_LOCK_RAD = VehicleParameters().max_steering


class StateConfig(Config):
    """Configuration of a state.

    Attributes:
        vision: "semantic": latents of the semantic camera; "none": the exact state of the others.
        frames: Number of pictures, a tick apart.
        localization: "truth", or a filter of `dohyo.agents.localization`, such as "es-ekf".
        gnss: The filter's receiver: "gnss" or "gnss_rtk".
        encoder: File of the encoder; None: the shipped one.
    """

    vision: Literal["semantic", "none"] = "semantic"
    frames: Annotated[int, Field(ge=1, le=16)] = 4
    localization: Literal["truth", "es-ekf", "ekf", "ukf"] = "truth"
    gnss: Literal["gnss", "gnss_rtk"] = "gnss_rtk"
    encoder: Path | None = None


class StateEncoder:
    """Turns one ego's observations into states.

    Attributes:
        config: Of the state.
        sensors: Needed in an observation.
        layout: Slice of each part in the vector.
        size: Length of the vector.

    The parts, in this order; a number in brackets is what a value of 1 stands for:

    * `z` (frames x 400): latents of the last pictures, oldest first. At first, the first picture's stand for all.
    * or, without pictures, `actors`, `strips`, `junctions`, `crossings`, `distances`: see `nearby`, row by row, and
      `allowances`.
    * `waypoints` (16): x [30 m], y [10 m] of the path 2, 5, 10, 15, 20, 30, 40 and 60 m ahead, ego frame.
    * `deviation` (3): distance to the left of the path [3 m], sine and cosine of the heading to it.
    * `limits` (3): speed limit here, the lowest within 30 m, and the speed from which gentle braking meets every limit
      and bend ahead [15 m/s].
    * `place` (4): x, y [500 m], cosine and sine of the heading, in the frame of where the mission began.
    * `motion` (3): speed [15 m/s], the same up to walking pace [1 m/s, at most 1], front wheel angle [full lock].
    """

    def __init__(self, config: StateConfig | None = None) -> None:
        """Loads the encoder, if there is one.

        Raises:
            InvalidInputError: Its file is missing or damaged.
        """
        self.config = config or StateConfig()
        self._encoder: Encoder | None = None
        parts = {"actors": nearby.ACTORS * nearby.ACTOR_COLUMNS, "strips": nearby.STRIPS * nearby.STRIP_COLUMNS}
        parts |= {"junctions": nearby.JUNCTIONS * nearby.JUNCTION_COLUMNS}
        parts |= {"crossings": nearby.CROSSINGS * nearby.CROSSING_COLUMNS, "distances": 2}
        parts |= {"allowances": ALLOWANCES}
        if self.config.vision == "semantic":
            self._encoder = Encoder(self.config.encoder or SHIPPED)
            parts = {"z": self.config.frames * self._encoder.size}
        parts |= {"waypoints": 2 * len(WAYPOINTS_M), "deviation": 3, "limits": 3, "place": 4, "motion": 3}
        ends = np.cumsum(list(parts.values())).tolist()
        slices = {name: slice(end - parts[name], end) for name, end in zip(parts, ends, strict=True)}
        self.layout: Mapping[str, slice] = MappingProxyType(slices)
        self.size: int = ends[-1]
        self.sensors = self._sensors()
        self.reset()

    @property
    def space(self) -> Box:
        """Numbers in one state."""
        return Box(-np.inf, np.inf, (self.size,), np.float32)

    @property
    def files(self) -> tuple[Path, ...]:
        """Files that decide the state: the encoder's, with pictures."""
        return () if self._encoder is None else (self.config.encoder or SHIPPED,)

    @property
    def calibrating(self) -> bool:
        """Whether the filter needs the vehicle to stand. Until it runs, the true pose is used, as of a parked car.

        Never true with localization "truth".
        """
        return self._view is not None and self._view.pose is None

    def warm_up(self) -> None:
        """Compiles the kernels of the filter, if there is one."""
        if self._view is not None:
            self._view.warm_up()

    def reset(self) -> None:
        """Clears the state of the last episode."""
        config = self.config
        self._latents: deque[Float32Array] = deque(maxlen=config.frames)
        self._view: LocalizedView | None = None
        if config.localization != "truth":
            self._view = LocalizedView(config.localization, config.gnss)
        self._origin: tuple[float, float, float] | None = None

    def located(self, observation: Observation) -> Observation:
        """Observation at the filter's pose; unchanged with localization "truth".

        A lateral offset of `route` must be applied to the result. Once per tick.
        """
        if self._view is None:
            return observation
        seen = {**observation, **self._view.seen(observation)}
        begin = observation["route_map"][0].astype(np.float64)
        self._origin = self._origin or (float(begin[0]), float(begin[1]), float(begin[2]))
        # Until the filter runs, the vehicle is parked where its mission begins.
        seen[BELIEVED] = _in_frame(self._origin, self._view.pose or self._origin)
        return seen

    def encode(self, observation: Observation) -> Float32Array:
        """State; once per tick, since a picture's latents are kept for later states.

        Args:
            observation: With `sensors`; or the result of `located`.

        Returns:
            (size,) see `layout`.
        """
        if self._view is not None and BELIEVED not in observation:
            observation = self.located(observation)
        out = np.empty(self.size, dtype=np.float32)
        layout, route = self.layout, observation["route"]
        if self._encoder is not None:
            out[layout["z"]] = self._last_latents(self._encoder, observation[CAMERA])
        else:
            out[layout["actors"]] = nearby.actors_near(observation).ravel()
            strips, conflicts = nearby.strips(observation), observation["conflicts"]
            out[layout["strips"]] = strips.ravel()
            out[layout["junctions"]] = nearby.junctions(observation).ravel()
            out[layout["crossings"]] = nearby.crossings(conflicts).ravel()
            out[layout["allowances"]] = allowances(strips, observation["junctions_ahead"], conflicts)
            out[layout["distances"]] = nearby.root(nearby.distances(observation) / (nearby.IMPACT_M, nearby.EVENT_M))
        points = route[WAYPOINTS_M, :2] / (AHEAD_UNIT_M, ASIDE_UNIT_M)
        out[layout["waypoints"]] = points.ravel()
        out[layout["deviation"]] = _deviation(route)
        limit = route[: LIMIT_AHEAD_M + 1, 4]
        speeds = limit[0], limit.min(), advised_speed(route)
        out[layout["limits"]] = np.array(speeds) / SPEED_UNIT_M_S
        x, y, heading = (observation[BELIEVED] if self._view is not None else observation["ego_state"])[:3].tolist()
        out[layout["place"]] = x / PLACE_UNIT_M, y / PLACE_UNIT_M, math.cos(heading), math.sin(heading)
        speed, steering = observation["speedometer"].tolist()
        out[layout["motion"]] = speed / SPEED_UNIT_M_S, min(speed / WALKING_M_S, 1.0), steering / _LOCK_RAD
        return out

    def _last_latents(self, encoder: Encoder, picture: np.ndarray) -> Float32Array:
        latent = encoder.latent(picture)
        missing = self.config.frames - len(self._latents)
        self._latents.extend([latent] * max(missing, 1))
        return np.concatenate(self._latents)

    def _sensors(self) -> tuple[str, ...]:
        of_others = (CAMERA,) if self.config.vision == "semantic" else nearby.SENSORS
        of_itself: tuple[str, ...] = ("ego_state",)
        if self.config.localization != "truth":
            of_itself = ("imu", self.config.gnss, "route_map", "navigation")
        return tuple(dict.fromkeys(("speedometer", "route", *of_others, *of_itself)))


def _deviation(route: Float32Array) -> tuple[float, float, float]:
    """Distance to the left of the path [3 m], sine and cosine of the heading to it."""
    x, y, heading = route[0, :3].tolist()
    left = x * math.sin(heading) - y * math.cos(heading)
    return left / DEVIATION_UNIT_M, math.sin(-heading), math.cos(heading)


def _in_frame(origin: tuple[float, float, float], pose: tuple[float, float, float]) -> Float32Array:
    """(3,) pose of the network frame in the frame of another pose."""
    dx, dy = pose[0] - origin[0], pose[1] - origin[1]
    cos, sin = math.cos(origin[2]), math.sin(origin[2])
    return np.array([dx * cos + dy * sin, dy * cos - dx * sin, pose[2] - origin[2]], dtype=np.float32)
