"""View: an observation as it looks from a filter's estimated pose.

The filter uses the IMU and the GNSS receiver alone. Map data at the ego (`route`, `lane`, `navigation`) are recomputed
from the estimated pose; observations of others, relative to the ego, stay.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from dohyo.agents.localization.filters.base import FilterNoise
from dohyo.agents.localization.localizer import FILTERS, Localizer
from dohyo.agents.localization.settings import CarConstraint, Settings
from dohyo.agents.planning.warm_up import empty_road
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import UnknownNameError
from dohyo.sumo_networks.geometry import project_on_path, wrap
from dohyo.sumo_networks.sensors.gnss import L80, RTK, GnssNoise
from dohyo.sumo_networks.sensors.route import path_ahead
from dohyo.sumo_networks.units import SUBSTEP_S, TICK_S

STANDING_S = 3.0
HEADING_STD = math.radians(3.0)
"""Standard deviation of a parked car's heading, taken from its lane; ours."""
BEHIND_M, AHEAD_M = 15.0, 30.0
RECEIVERS: Mapping[str, GnssNoise] = MappingProxyType({"gnss": L80, "gnss_rtk": RTK})
FROM_POSE = frozenset({"route", "lane", "navigation"})


class LocalizedView:
    """Follows one ego through one episode, which begins at rest.

    Attributes:
        localizer: Filter with its calibration; from the first observation on.
    """

    localizer: Localizer

    def __init__(self, localization: str = "es-ekf", gnss: str = "gnss") -> None:
        """Prepares for an episode.

        Args:
            localization: A name of `localizer.FILTERS`.
            gnss: The receiver: "gnss" or "gnss_rtk".

        Raises:
            UnknownNameError: A name is unknown.
        """
        if localization not in FILTERS:
            raise UnknownNameError("filter", localization, FILTERS)
        if gnss not in RECEIVERS:
            raise UnknownNameError("receiver", gnss, RECEIVERS)
        self._settings = Settings(
            filter=localization,
            start="standing",
            standing_s=STANDING_S,
            gnss_sigma_m=RECEIVERS[gnss].sigma_m,
            outliers="gate",  # the simulated receivers have none; so drives stay those of the published records
            noise=FilterNoise(),
            car=CarConstraint(level_rad=None),
        )
        self._gnss = gnss
        self._tick = 0
        self._progress = 0.0
        self._route_length = math.nan

    @property
    def sensors(self) -> tuple[str, ...]:
        """Sensors that an observation must hold, besides those that are recomputed."""
        return "imu", self._gnss, "route_map"

    @property
    def pose(self) -> tuple[float, float, float] | None:
        """East, north [m] and heading [rad]; None while the vehicle has to stand for the calibration."""
        return self.localizer.pose if self._tick else None

    def warm_up(self) -> None:
        """Compiles the kernels: stands on an empty road until the filter has run for two ticks."""
        trial = LocalizedView(self._settings.filter, self._gnss)
        observation = empty_road((*sorted(FROM_POSE), *self.sensors))
        for _ in range(round(STANDING_S / TICK_S) + 3):
            trial.seen(observation)

    def seen(self, observation: Observation) -> Observation:
        """Recomputed sensors at the estimated pose: those of `FROM_POSE` in the observation.

        Args:
            observation: Of the next tick, with `sensors`.

        Returns:
            The recomputed sensors; unchanged ones while there is no estimate.
        """
        if self._tick == 0:
            self.localizer = Localizer(self._settings, (float(observation["route_map"][0, 2]), HEADING_STD))
        self._sense(observation)
        self._tick += 1
        held = {name: observation[name] for name in FROM_POSE if name in observation}
        return held if self.pose is None else self._seen_from(self.pose, held, observation["route_map"])

    def _sense(self, observation: Observation) -> None:
        """Passes IMU and receiver to the filter."""
        now = self._tick * TICK_S
        samples = observation["imu"].astype(np.float64)
        for i, sample in enumerate(samples):
            self.localizer.imu(now - (len(samples) - 1 - i) * SUBSTEP_S, sample)
        fix = observation[self._gnss].astype(np.float64)
        if fix[0] > 0.0:
            self.localizer.gnss(now, fix[1:4])

    def _seen_from(self, pose: tuple[float, float, float], seen: Observation, route_map: Float32Array) -> Observation:
        """Sensors that depend on the pose, at the estimated one."""
        x, y, heading = pose
        page = route_map.astype(np.float64)
        page = page[: 1 + int(np.argmax(page[:, 7]))]  # past the goal the last point repeats
        spacing = float(page[1, 7] - page[0, 7]) if len(page) > 1 else 1.0
        near = (self._progress - page[0, 7]) / spacing
        first, last = int(near - BEHIND_M / spacing), math.ceil(near + AHEAD_M / spacing) + 1
        along, lateral, direction = project_on_path(x, y, page[:, :2].copy(), spacing, first, last)
        if math.isfinite(along):
            self._progress = float(page[0, 7]) + along
        row = min(max(round(along / spacing), 0), len(page) - 1)
        out = dict(seen)
        if "route" in seen:
            out["route"] = path_ahead(row, x, y, heading, page)
        if "lane" in seen:
            out["lane"] = _lane(page[row], lateral, wrap(heading - direction))
        if "navigation" in seen:
            _, left, driven = seen["navigation"].tolist()
            if math.isnan(self._route_length):
                self._route_length = left + driven  # the length of the mission, which is known
            remaining = max(self._route_length - self._progress, 0.0)
            out["navigation"] = np.array([page[row, 6], remaining, self._progress], dtype=np.float32)
        return out


def _lane(point: np.ndarray, lateral: float, heading_error: float) -> Float32Array:
    """(5,) as `sensors.lane.Lane`, of the route's own lane, since the estimated pose may be wrong."""
    width, limit = float(point[5]), float(point[4])
    return np.array([abs(lateral) <= 0.5 * width, lateral, heading_error, width, limit], dtype=np.float32)
