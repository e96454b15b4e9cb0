"""IDM: follows its route and the leader in its path. The weakest planner in the comparisons.

Source: Treiber, Hennecke, Helbing 2000; as a planner, nuPlan's baseline of that name. Slowing down for curves and
stopping at closed lines are ours: it has no other way to survive a turn or a light.
"""

from __future__ import annotations

import numpy as np

from dohyo.agents.planning.motion import Idm, body, idm_acceleration, limited_steering, pursuit
from dohyo.agents.planning.prediction import constant_velocity
from dohyo.agents.planning.scene import SENSORS, SceneBuilder
from dohyo.agents.planning.situation import NO_LINE, Situation, at_row, leader, situation
from dohyo.agents.planning.warm_up import empty_road
from dohyo.evaluation.agent import Agent, AgentSpec, Explanation, Mission, Observation
from dohyo.sumo_networks.ego.dynamics import VehicleParameters

MODEL = Idm(gap=1.0, headway=1.5, acceleration=1.5, braking=3.0, exponent=4.0, least_gap=0.1, hardest=5.0)
MAX_SPEED, CURVE_LATERAL, CURVE_BRAKING, LATERAL_LIMIT = 13.9, 2.5, 1.5, 6.0
CORRIDOR_MARGIN_M = 0.2
LINE_GAP_M = 0.5
ABOVE_TARGET_S = 1.0


class IdmPlanner(Agent):
    """Pure pursuit of the route, and IDM's acceleration behind the nearest actor on it."""

    spec = AgentSpec(name="idm", track="privileged", sensors=SENSORS, control="acceleration_steering")

    def __init__(self) -> None:
        self._vehicle = VehicleParameters()
        self._car = body(self._vehicle, LATERAL_LIMIT)
        self._builder = SceneBuilder()
        self._why: Explanation = {}

    def warm_up(self) -> None:
        """Decides on an empty road."""
        self.act(empty_road(self.spec.sensors))

    def reset(self, mission: Mission, seed: int) -> None:
        """Clears the state of the last episode."""
        self._builder.reset()
        self._why = {}

    def act(self, observation: Observation) -> np.ndarray:
        """IDM's acceleration, and pure pursuit's steering."""
        scene = self._builder.update(observation)
        road = situation(
            scene, constant_velocity(scene), max_speed=MAX_SPEED, curve=CURVE_LATERAL, braking=CURVE_BRAKING
        )  # fmt: skip
        speed = scene.ego.speed
        steering = pursuit(self._car, road.path, road.first_s, road.spacing, -self._car.axle, 0.0, 0.0, speed, 0.0, 0.0)
        wheel = limited_steering(self._car, speed, steering)
        return np.array([self._acceleration(road, speed), wheel / self._vehicle.max_steering])

    def explain(self) -> Explanation | None:
        """Leader, and the acceleration that follows from it."""
        return self._why

    def _acceleration(self, road: Situation, speed: float) -> float:
        target = float(road.allowed[at_row(road, 0.0)])
        gap, leading = leader(road, 0.5 * self._car.length, 0.5 * self._car.width + CORRIDOR_MARGIN_M, 0.0, 0.0, 0.0)
        line = road.line - 0.5 * self._car.length - LINE_GAP_M + MODEL.gap if road.line < NO_LINE else np.inf
        behind = "leader" if gap <= line else "line"
        if line < gap:
            gap, leading = line, 0.0
        wish = float(idm_acceleration(MODEL, speed, target, gap, leading))
        if speed > target:
            wish = min(wish, max((target - speed) / ABOVE_TARGET_S, -MODEL.hardest))
        self._why = {
            "behind": behind if np.isfinite(gap) else None,
            "gap_m": round(float(gap), 2) if np.isfinite(gap) else None,
            "leader_speed": round(float(leading), 2),
            "target_speed": round(target, 2),
            "acceleration": round(wish, 2),
        }
        return wish
