"""PDM-Closed: simulates fifteen ways to follow the route, scores them, and begins the best.

Source: Dauner, Hallgarten, Geiger, Chitta, "Parting with Misconceptions about Learning-based Vehicle Motion Planning",
2023. Its description, not its code, which had leaders at zero in the first step, state shared between proposals, and
speeds below zero; here every proposal has a state of its own, the leader is known from the first step, and nobody
drives backwards.
"""

from __future__ import annotations

import numpy as np

from agents.experts.proposals import (
    COMFORT,
    DAC,
    DDC,
    EP,
    FACTORS,
    MET_AT,
    NC,
    OFFSETS_M,
    PROPOSALS,
    SCORES,
    STATE,
    STEPS,
    TOTAL,
    TTC,
    roll_out,
    score,
)
from agents.planning.motion import Idm, body
from agents.planning.prediction import constant_velocity
from agents.planning.scene import SENSORS, SceneBuilder
from agents.planning.situation import situation
from agents.planning.warm_up import empty_road
from evaluation.agent import Agent, AgentSpec, Explanation, Mission, Observation
from sumo_networks.vehicle import VehicleParameters

MODEL = Idm(gap=1.0, headway=1.5, acceleration=1.5, braking=3.0, exponent=10.0, least_gap=1.0, hardest=3.0)
MAX_SPEED = 15.0
CURVE_LATERAL, CURVE_BRAKING, LATERAL_LIMIT = 2.5, 1.5, 6.0
CORRIDOR_MARGIN_M = 0.2
LINE_GAP_M = 0.5
EMERGENCY_S, EMERGENCY_SPEED, EMERGENCY_BRAKING = 2.0, 5.0, 4.05


class PdmClosed(Agent):
    """The planner. Steering is pure pursuit instead of LQR, actuator lags are those of the ego here (ours)."""

    spec = AgentSpec(name="pdm-closed", track="privileged", sensors=SENSORS, control="acceleration_steering")

    def __init__(self) -> None:
        self._vehicle = VehicleParameters()
        self._car = body(self._vehicle, LATERAL_LIMIT)
        self._builder = SceneBuilder()
        self._states = np.zeros((PROPOSALS, STEPS + 1, STATE))
        self._scores = np.zeros((PROPOSALS, SCORES))
        self._chosen, self._braking = -1, False
        self.act(empty_road(self.spec.sensors))

    def reset(self, mission: Mission, seed: int) -> None:
        """Forgets the last episode."""
        self._builder.reset()
        self._chosen, self._braking = -1, False

    def act(self, observation: Observation) -> np.ndarray:
        """The first step of the best proposal, or an emergency brake."""
        scene = self._builder.update(observation)
        road = situation(
            scene, constant_velocity(scene), max_speed=MAX_SPEED, curve=CURVE_LATERAL, braking=CURVE_BRAKING
        )  # fmt: skip
        ego, start = scene.ego, np.zeros(STATE)
        start[:6] = -self._car.axle, 0.0, 0.0, ego.speed, ego.acceleration, ego.steering
        roll_out(road, self._car, MODEL, LINE_GAP_M, CORRIDOR_MARGIN_M, start, self._states)
        score(road, self._car, self._states, self._scores)
        best = self._best()
        wheel, demand = self._states[best, 0, -2:]
        self._braking = bool(self._scores[best, MET_AT] <= EMERGENCY_S and ego.speed <= EMERGENCY_SPEED)
        self._chosen = best
        if self._braking:
            demand = -EMERGENCY_BRAKING
        return np.array([demand, wheel / self._vehicle.max_steering])

    def _best(self) -> int:
        """The highest score; among equals the one on the centreline, then the slowest where all are bad."""
        totals = self._scores[:, TOTAL]
        if totals.max() <= 0.0:  # whichever meets somebody last; the slower among equals
            return int(np.argmax(np.minimum(self._scores[:, MET_AT], 1e3)))
        return int(np.argmax(totals.round(9)))

    def explain(self) -> Explanation | None:
        """Every proposal with its terms, and the trajectory of the chosen one in the ego's frame."""
        if self._chosen < 0:
            return None
        names = {"nc": NC, "dac": DAC, "ddc": DDC, "ep": EP, "ttc": TTC, "comfort": COMFORT, "score": TOTAL}
        proposals = [
            {"offset_m": OFFSETS_M[i // len(FACTORS)], "speed_factor": FACTORS[i % len(FACTORS)]}
            | {name: round(float(self._scores[i, column]), 3) for name, column in names.items()}
            for i in range(PROPOSALS)
        ]
        return {
            "agent": self.spec.name,
            "chosen": self._chosen,
            "emergency_brake": self._braking,
            "proposals": proposals,
            "trajectory": self._states[self._chosen, :, 7:9].round(2).tolist(),
        }
