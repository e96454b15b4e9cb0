"""Localized: any agent, driving by a filter's estimated pose instead of the true one.

    dohyo evaluate --agent autopilot --benchmark quickstart --set localization=es-ekf --set gnss=gnss_rtk

Map data at the ego are recomputed, see `view`; observations of others stay.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np

from dohyo.agents.localization.localizer import FILTERS, Localizer
from dohyo.agents.localization.view import FROM_POSE, LocalizedView
from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import Agent, AgentSpec, Explanation, Mission, Observation, make_agent
from dohyo.evaluation.settings import OneOf
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

STAND: Mapping[str, np.ndarray] = MappingProxyType(
    {
        "pedals_steering": np.array([0.0, 1.0, 0.0]),
        "acceleration_steering": np.array([-3.0, 0.0]),
        "target_speed_steering": np.zeros(2),
        "waypoints": np.zeros((8, 2)),
        "lane_command": np.zeros(2),
    }
)
"""Action that keeps a vehicle standing, by control."""


class Localized(Agent):
    """See the module.

    Attributes:
        inner: The agent that drives.
    """

    def __init__(
        self,
        inner: str = "autopilot",
        localization: Annotated[str, OneOf(FILTERS)] = "es-ekf",
        gnss: Literal["gnss", "gnss_rtk"] = "gnss",
        **settings: Any,
    ) -> None:
        """Wraps an agent.

        Args:
            inner: A registered name, or "module:Class".
            localization: A name of `localizer.FILTERS`.
            gnss: The receiver: "gnss" or "gnss_rtk".
            settings: Of the inner agent.

        Raises:
            InvalidInputError: A name is unknown, or no sensor of the agent depends on its pose.
        """
        self._believes = localization, gnss
        self._view = LocalizedView(*self._believes)
        self.inner = make_agent(resolve(inner), settings)
        spec = self.inner.spec
        if not FROM_POSE & set(spec.sensors):
            raise InvalidInputError(
                f"agent '{spec.name}' with localization: expected one of the sensors {', '.join(sorted(FROM_POSE))}, "
                f"got {', '.join(spec.sensors)}"
            )
        if spec.control not in STAND:
            raise UnknownNameError("control that can be held at rest", spec.control, STAND)
        self.spec = AgentSpec(
            name=f"{spec.name}+{localization}",
            track="privileged" if spec.track == "privileged" else "map",
            sensors=tuple(dict.fromkeys((*spec.sensors, *self._view.sensors))),
            control=spec.control,
        )

    @property
    def localizer(self) -> Localizer:
        """Localizer of the current episode."""
        return self._view.localizer

    def warm_up(self) -> None:
        """Warms up the inner agent and the filter."""
        self.inner.warm_up()
        self._view.warm_up()

    def reset(self, mission: Mission, seed: int) -> None:
        """Clears the state of the last episode."""
        self.inner.reset(mission, seed)
        self._view = LocalizedView(*self._believes)

    def act(self, observation: Observation) -> np.ndarray:
        """Stands while the IMU is calibrated; then the inner agent's action at the estimated pose."""
        seen = {**observation, **self._view.seen(observation)}
        if self._view.pose is None:
            return STAND[self.spec.control].copy()
        return self.inner.act({name: seen[name] for name in self.inner.spec.sensors})

    def explain(self) -> Explanation | None:
        """Explanation of the inner agent, and the estimated pose."""
        pose = self._view.pose
        if pose is None or self.localizer.filter is None:
            return {"localization": "standing still to calibrate"}
        spread = np.sqrt(np.diag(self.localizer.filter.position_covariance)[:2])
        own = {"x_m": round(pose[0], 2), "y_m": round(pose[1], 2), "sigma_m": [round(float(s), 2) for s in spread]}
        return {**(self.inner.explain() or {}), "localization": own}

    def close(self) -> None:
        """See `Agent`."""
        self.inner.close()
