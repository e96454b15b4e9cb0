"""Shield: any agent, with RSS between it and the vehicle.

    dohyo evaluate --agent autopilot --benchmark quickstart --set shield=rss

While a situation is dangerous, the shield brakes by RSS's proper response, whatever the agent's speed, and prevents
steering towards an actor too near at the side. At all other times the action is unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np

from dohyo.agents.planning.warm_up import empty_road
from dohyo.agents.registry import resolve_with
from dohyo.agents.safety.rss import CONSTANTS
from dohyo.agents.safety.rss_monitor import SENSORS, Danger, RssMonitor
from dohyo.evaluation.agent import Agent, AgentSpec, Explanation, Mission, Observation, make_agent
from dohyo.evaluation.settings import OneOf
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.ego.control import WAYPOINT_INTERVAL_S
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import UnknownNameError
from dohyo.sumo_networks.sensors.path import BEHIND

SPEED_GAIN = 1.6
"""Gain of controls with a target speed, 1/s: deceleration per speed above the target."""
_CAR = VehicleParameters()


class Shielded(Agent):
    """See the module.

    Attributes:
        inner: The agent that drives.
        watch: RSS monitor, with the share of critical time.
        interventions: Ticks in which the action was changed.
    """

    def __init__(
        self, inner: str = "autopilot", shield: Annotated[str, OneOf(CONSTANTS)] = "rss", **settings: Any
    ) -> None:
        """Wraps an agent.

        Args:
            inner: A registered name, or "module:Class".
            shield: A name of `rss.CONSTANTS`.
            settings: Of the inner agent; with `localization` it drives by a filter's pose.

        Raises:
            InvalidInputError: A name is unknown, or the agent cannot be made.
        """
        if shield not in CONSTANTS:
            raise UnknownNameError("shield", shield, CONSTANTS)
        self.inner = make_agent(*resolve_with(inner, settings))
        spec = self.inner.spec
        if spec.control not in RESPONSES:
            raise UnknownNameError("control that can be shielded", spec.control, RESPONSES)
        self._respond = RESPONSES[spec.control]
        self.watch = RssMonitor(CONSTANTS[shield])
        self.interventions = 0
        self._changed = False
        self.spec = AgentSpec(
            name=f"{spec.name}+{shield}",
            track="privileged",
            sensors=(*spec.sensors, *(name for name in SENSORS if name not in spec.sensors)),
            control=spec.control,
        )

    def warm_up(self) -> None:
        """Warms up the inner agent, and judges an empty road."""
        self.inner.warm_up()
        self.watch.update(empty_road(self.spec.sensors))

    def reset(self, mission: Mission, seed: int) -> None:
        """Clears the state of the last episode."""
        self.inner.reset(mission, seed)
        self.watch.reset()
        self.interventions, self._changed = 0, False

    def act(self, observation: Observation) -> np.ndarray:
        """Action of the inner agent, changed if RSS requires it."""
        wanted = self.inner.act({name: observation[name] for name in self.inner.spec.sensors})
        dangers = self.watch.update(observation)
        self._changed = False
        if not dangers:
            return wanted
        answer = shielded(wanted, dangers, observation, self._respond)
        self._changed = not np.array_equal(answer, wanted)
        self.interventions += self._changed
        return answer

    def explain(self) -> Explanation | None:
        """Explanation of the inner agent, dangerous actors, and whether the shield changed the action."""
        own = {
            "critical": self.watch.critical,
            "changed": self._changed,
            "critical_share": round(self.watch.share, 4),
            "dangers": [danger.as_json() for danger in self.watch.dangers],
        }
        return {**(self.inner.explain() or {}), "rss": own}

    def close(self) -> None:
        """See `Agent`."""
        self.inner.close()


Response = Callable[[np.ndarray, float, float, float, float, Observation], np.ndarray]
"""An action, braking asked for [m/s^2], speed [m/s], least and greatest steering allowed [rad], the observation."""


def shielded(
    wanted: np.ndarray, dangers: tuple[Danger, ...], observation: Observation, respond: Response
) -> np.ndarray:
    """Action nearest to the wanted one that responds to all dangers."""
    along = _steering_along(observation["path"])
    most = min((along for danger in dangers if danger.side > 0), default=math.inf)
    least = max((along for danger in dangers if danger.side < 0), default=-math.inf)
    braking = max(danger.braking for danger in dangers)
    action = np.array(wanted, dtype=np.float64)
    return respond(action, braking, float(observation["speedometer"][0]), least, max(most, least), observation)


def _steering_along(path: Float32Array) -> float:
    """Front wheel angle with which the ego keeps its distance to the path, rad."""
    heading = float(path[BEHIND, 2])
    return math.atan(_CAR.wheelbase * float(path[BEHIND + 2, 3])) + heading


def _clipped(steering: float, least: float, most: float) -> float:
    """A steering action in [-1, 1] of full lock, within bounds in rad."""
    return float(np.clip(np.clip(steering * _CAR.max_steering, least, most) / _CAR.max_steering, -1.0, 1.0))


def _pedals(action: np.ndarray, braking: float, speed: float, least: float, most: float, _: Observation) -> np.ndarray:
    if braking > 0.0:
        action[0], action[1] = 0.0, max(action[1], min(braking / _CAR.max_braking, 1.0))
    action[2] = _clipped(action[2], least, most)
    return action


def _acceleration(
    action: np.ndarray, braking: float, speed: float, least: float, most: float, _: Observation
) -> np.ndarray:
    action[0] = min(action[0], -braking) if braking > 0.0 else action[0]
    action[1] = _clipped(action[1], least, most)
    return action


def _slower(target: float, braking: float, speed: float) -> float:
    return min(target, max(speed - braking / SPEED_GAIN, 0.0)) if braking > 0.0 else target


def _target_speed(
    action: np.ndarray, braking: float, speed: float, least: float, most: float, _: Observation
) -> np.ndarray:
    action[0] = _slower(float(action[0]), braking, speed)
    action[1] = _clipped(action[1], least, most)
    return action


def _lane_command(
    action: np.ndarray, braking: float, speed: float, least: float, most: float, _: Observation
) -> np.ndarray:
    action[0] = _slower(float(action[0]), braking, speed)
    if (math.isfinite(most) and action[1] > 0.0) or (math.isfinite(least) and action[1] < 0.0):
        action[1] = 0.0
    return action


def _waypoints(
    action: np.ndarray, braking: float, speed: float, least: float, most: float, observation: Observation
) -> np.ndarray:
    """Waypoints moved closer together along their way, and not further to a side than the ego."""
    path = observation["path"].astype(np.float64)
    here = path[BEHIND]
    beside = np.interp(action[:, 0], path[BEHIND:, 0], path[BEHIND:, 1] - here[1])
    if math.isfinite(most):
        action[:, 1] = np.minimum(action[:, 1], beside)
    if math.isfinite(least):
        action[:, 1] = np.maximum(action[:, 1], beside)
    target = float(np.hypot(*np.diff(np.vstack([[0.0, 0.0], action[:2]]), axis=0).T).mean()) / WAYPOINT_INTERVAL_S
    slower = _slower(target, braking, speed)
    return action * (slower / target) if slower < target else action


RESPONSES: Mapping[str, Response] = MappingProxyType(
    {
        "pedals_steering": _pedals,
        "acceleration_steering": _acceleration,
        "target_speed_steering": _target_speed,
        "waypoints": _waypoints,
        "lane_command": _lane_command,
    }
)
"""Response of each control."""
