"""Localized: any agent, made to drive by the pose that a filter estimates instead of the true one.

    dohyo evaluate --agent autopilot --benchmark quickstart --set localization=es-ekf --set gnss=gnss_rtk

The filter is given the IMU and the GNSS receiver, and nothing else. What the agent's map says of its place (`route`,
`lane`, `navigation`) is worked out anew from the estimated pose; what it sees of others, relative to itself, stays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from agents.localization.localizer import FILTERS, Localizer, Settings
from agents.registry import resolve
from evaluation.agent import Agent, AgentSpec, Explanation, Mission, Observation, make_agent
from sumo_networks.arrays import Float32Array
from sumo_networks.errors import InvalidInputError, UnknownNameError
from sumo_networks.geometry import project_on_path, wrap
from sumo_networks.sensors.gnss import L80, RTK, GnssNoise
from sumo_networks.sensors.route import path_ahead

STANDING_S = 3.0
HEADING_STD = math.radians(3.0)
"""How well a parked car's heading is known from that of its lane; ours."""
TICK_S, SAMPLE_S = 0.1, 0.01
BEHIND_M, AHEAD_M = 15.0, 30.0
RECEIVERS: Mapping[str, GnssNoise] = MappingProxyType({"gnss": L80, "gnss_rtk": RTK})
FROM_POSE = frozenset({"route", "lane", "navigation"})
STAND: Mapping[str, np.ndarray] = MappingProxyType(
    {
        "pedals_steering": np.array([0.0, 1.0, 0.0]),
        "acceleration_steering": np.array([-3.0, 0.0]),
        "target_speed_steering": np.zeros(2),
        "waypoints": np.zeros((8, 2)),
        "lane_command": np.zeros(2),
    }
)
"""What keeps a vehicle standing, by control."""


class Localized(Agent):
    """See the module.

    Attributes:
        inner: The agent that drives.
        localizer: Of the current episode.
    """

    localizer: Localizer

    def __init__(
        self, inner: str = "autopilot", localization: str = "es-ekf", gnss: str = "gnss", **settings: Any
    ) -> None:
        """Wraps an agent.

        Args:
            inner: A registered name, or "module:Class".
            localization: A name of `localizer.FILTERS`.
            gnss: The receiver: "gnss" or "gnss_rtk".
            settings: Of the inner agent.

        Raises:
            InvalidInputError: A name is unknown, or the agent sees nothing that depends on its pose.
        """
        if localization not in FILTERS:
            raise UnknownNameError("filter", localization, FILTERS)
        if gnss not in RECEIVERS:
            raise UnknownNameError("receiver", gnss, RECEIVERS)
        self.inner = make_agent(resolve(inner), settings)
        spec = self.inner.spec
        if not FROM_POSE & set(spec.sensors):
            raise InvalidInputError(
                f"agent '{spec.name}' asks for localization, but for none of the sensors {', '.join(sorted(FROM_POSE))}"
            )
        if spec.control not in STAND:
            raise UnknownNameError("control that can be held at rest", spec.control, STAND)
        self._settings = Settings(filter=localization, gnss_sigma_m=RECEIVERS[gnss].sigma_m, standing_s=STANDING_S)
        self._gnss = gnss
        self.spec = AgentSpec(
            name=f"{spec.name}+{localization}",
            track="privileged" if spec.track == "privileged" else "map",
            sensors=(*spec.sensors, *(name for name in ("imu", gnss, "route_map") if name not in spec.sensors)),
            control=spec.control,
        )

    def reset(self, mission: Mission, seed: int) -> None:
        """Forgets the last episode."""
        self.inner.reset(mission, seed)
        self._tick = 0
        self._progress = 0.0
        self._route_length = math.nan

    def act(self, observation: Observation) -> np.ndarray:
        """Stands while the IMU is calibrated; then what the inner agent does in the estimated place."""
        if self._tick == 0:
            self.localizer = Localizer(self._settings, (float(observation["route_map"][0, 2]), HEADING_STD))
        self._sense(observation)
        self._tick += 1
        pose = self.localizer.pose
        if pose is None:
            return STAND[self.spec.control].copy()
        return self.inner.act(self._seen_from(pose, observation))

    def explain(self) -> Explanation | None:
        """What the inner agent says, and where the vehicle is believed to be."""
        pose = self.localizer.pose if self._tick else None
        if pose is None or self.localizer.filter is None:
            return {"localization": "standing still to calibrate"}
        spread = np.sqrt(np.diag(self.localizer.filter.position_covariance)[:2])
        own = {"x_m": round(pose[0], 2), "y_m": round(pose[1], 2), "sigma_m": [round(float(s), 2) for s in spread]}
        return {**(self.inner.explain() or {}), "localization": own}

    def close(self) -> None:
        """See `Agent`."""
        self.inner.close()

    def _sense(self, observation: Observation) -> None:
        """Gives the filter what the IMU and the receiver say, and nothing else."""
        now = self._tick * TICK_S
        samples = observation["imu"].astype(np.float64)
        for i, sample in enumerate(samples):
            self.localizer.imu(now - (len(samples) - 1 - i) * SAMPLE_S, sample)
        fix = observation[self._gnss].astype(np.float64)
        if fix[0] > 0.0:
            self.localizer.gnss(now, fix[1:4])

    def _seen_from(self, pose: tuple[float, float, float], observation: Observation) -> Observation:
        """The observation, with what depends on the pose as the estimated one would have it."""
        x, y, heading = pose
        page = observation["route_map"].astype(np.float64)
        page = page[: 1 + int(np.argmax(page[:, 7]))]  # past the goal the last point repeats
        spacing = float(page[1, 7] - page[0, 7]) if len(page) > 1 else 1.0
        near = (self._progress - page[0, 7]) / spacing
        first, last = int(near - BEHIND_M / spacing), math.ceil(near + AHEAD_M / spacing) + 1
        along, lateral, direction = project_on_path(x, y, page[:, :2].copy(), spacing, first, last)
        if math.isfinite(along):
            self._progress = float(page[0, 7]) + along
        row = min(max(round(along / spacing), 0), len(page) - 1)
        seen = {name: observation[name] for name in self.inner.spec.sensors}
        if "route" in seen:
            table = np.ascontiguousarray(page.T)
            seen["route"] = path_ahead(
                row,
                x,
                y,
                heading,
                page[:, :2].copy(),
                table[2],
                table[3],
                table[4],
                table[5],
                page[:, 6].astype(np.int64),
            )
        if "lane" in seen:
            seen["lane"] = _lane(page[row], lateral, wrap(heading - direction))
        if "navigation" in seen:
            _, left, driven = observation["navigation"].tolist()
            if math.isnan(self._route_length):
                self._route_length = left + driven  # the length of the mission, which is no secret
            remaining = max(self._route_length - self._progress, 0.0)
            seen["navigation"] = np.array([page[row, 6], remaining, self._progress], dtype=np.float32)
        return seen


def _lane(point: np.ndarray, lateral: float, heading_error: float) -> Float32Array:
    """(5,) as `sensors.lane.Lane`, of the route's own lane: a map knows no better from a pose that may be wrong."""
    width, limit = float(point[5]), float(point[4])
    return np.array([abs(lateral) <= 0.5 * width, lateral, heading_error, width, limit], dtype=np.float32)
