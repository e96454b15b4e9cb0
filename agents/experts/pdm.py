"""PDM-Closed: simulates fifteen proposals along the route, scores them, and executes the best.

Source: Dauner, Hallgarten, Geiger, Chitta, "Parting with Misconceptions about Learning-based Vehicle Motion Planning",
2023. Written from its description. Unlike its public code, every proposal has a state of its own, the leader is known
from the first step, and speeds stay at 0 or above.
"""

from __future__ import annotations

from collections import deque
from typing import Literal, get_args

import numpy as np

from dohyo.agents.experts.detour import Detour
from dohyo.agents.experts.gaps import PASSING_ACCELERATION
from dohyo.agents.experts.proposals import (
    COMFORT,
    DAC,
    DDC,
    EP,
    FACTORS,
    MET_AT,
    NC,
    OFF_AT,
    OFFSETS_M,
    PROPOSALS,
    SCORES,
    SHORT_AT,
    STANDING,
    STATE,
    STEPS,
    TOTAL,
    TTC,
    roll_out,
    score,
)
from dohyo.agents.planning.braking import braking_on
from dohyo.agents.planning.motion import Idm, body
from dohyo.agents.planning.prediction import constant_speed, constant_velocity
from dohyo.agents.planning.scene import SENSORS, Scene, SceneBuilder
from dohyo.agents.planning.situation import Situation, situation
from dohyo.agents.planning.warm_up import empty_road
from dohyo.evaluation.agent import Agent, AgentSpec, Explanation, Mission, Observation
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import InvalidInputError

MODEL = Idm(gap=1.0, headway=1.5, acceleration=1.5, braking=3.0, exponent=10.0, least_gap=1.0, hardest=3.0)
PASSING_MODEL = MODEL._replace(acceleration=PASSING_ACCELERATION)
"""While it passes: the gaps are judged for that acceleration (ours)."""
RETURN_BONUS = 0.05
"""Of the proposals on the centreline, until the ego is back in the middle of its lane (ours)."""
MAX_SPEED = 15.0
CURVE_LATERAL, CURVE_BRAKING, LATERAL_LIMIT = 2.5, 1.5, 6.0
CORRIDOR_MARGIN_M = 0.2
LINE_GAP_M = 0.5
EMERGENCY_S, SHORT_S, EMERGENCY_BRAKING = 2.0, 1.0, 8.0
PUBLISHED_SPEED, PUBLISHED_BRAKING = 5.0, 4.05
MOVING = 1.0
LEEWAY_S = 0.2
MOST_CHANGE, EASED_TICKS = 3.7, 10
"""Largest change of the demanded acceleration within a second, m/s^2: comfort's 4.13 m/s^3, filtered."""
Variant = Literal["careful", "published"]


class PdmClosed(Agent):
    """The planner. Steering is pure pursuit instead of LQR, actuator lags are those of the ego here (ours).

    Args:
        variant: "published" brakes at 3 m/s^2 at most, in an emergency at 4.05 m/s^2, but up to 5 m/s only: a
            faster ego hits pedestrians that step out and leaders that brake hard. "careful" (ours) has an emergency
            brake of 8 m/s^2 at any speed, also where the best proposal leaves the road; waits for pedestrians about to
            cross; expects vehicles that turn to go on turning, and all in junctions to come a little earlier or later
            than forecast; and changes its braking gradually.
        passing: Whether "careful" goes round what stands in its lane (ours); "published" never does.
        looks_ahead: Whether "careful" expects vehicles that brake to go on braking for a second, and brakes hard where
            the time to collision will be short within a second whatever it does (ours); "published" never does.
    """

    spec = AgentSpec(name="pdm-closed", track="privileged", sensors=SENSORS, control="acceleration_steering")

    def __init__(self, variant: Variant = "careful", passing: bool = True, looks_ahead: bool = True) -> None:
        if variant not in get_args(Variant):
            raise InvalidInputError(f"agent 'pdm-closed': expected variant 'careful' or 'published', got '{variant}'")
        self._careful = variant == "careful"
        self._looks_ahead = looks_ahead and self._careful
        self._vehicle = VehicleParameters()
        self._car = body(self._vehicle, LATERAL_LIMIT)
        self._builder = SceneBuilder()
        self._detour = Detour(self._vehicle.length, self._vehicle.width) if passing and self._careful else None
        self._states = np.zeros((PROPOSALS, STEPS + 1, STATE))
        self._scores = np.zeros((PROPOSALS, SCORES))
        self._chosen, self._braking = -1, False
        self._asked: deque[float] = deque(maxlen=EASED_TICKS)

    def warm_up(self) -> None:
        """Decides on an empty road."""
        Detour.warm_up()
        self.act(empty_road(self.spec.sensors))

    def reset(self, mission: Mission, seed: int) -> None:
        """Clears the state of the last episode."""
        self._builder.reset()
        if self._detour is not None:
            self._detour.reset()
        self._chosen, self._braking = -1, False
        self._asked.clear()

    def act(self, observation: Observation) -> np.ndarray:
        """First step of the best proposal, or an emergency brake."""
        scene = self._builder.update(observation)
        road, model = self._look(observation, scene)
        ego, start = scene.ego, np.zeros(STATE)
        start[:6] = -self._car.axle, 0.0, 0.0, ego.speed, ego.acceleration, ego.steering
        roll_out(road, self._car, model, LINE_GAP_M, CORRIDOR_MARGIN_M, start, self._states, self._careful)
        score(road, self._car, self._states, self._scores, LEEWAY_S if self._careful else 0.0)
        best = self._best()
        wheel, demand = self._states[best, 0, -2:]
        self._chosen, self._braking = best, self._in_danger(best, ego.speed)
        if self._braking:
            demand = -(EMERGENCY_BRAKING if self._careful else PUBLISHED_BRAKING)
            self._asked.clear()
            self._asked.append(-MODEL.hardest)
        elif self._careful:
            demand = self._eased(float(demand), ego.speed)
        return np.array([demand, wheel / self._vehicle.max_steering])

    def _look(self, observation: Observation, scene: Scene) -> tuple[Situation, Idm]:
        """Situation along the route, or along the way round what stands on it, and how to follow others there."""
        forecast, model = constant_speed(scene) if self._careful else constant_velocity(scene), MODEL
        if self._looks_ahead:
            forecast = braking_on(scene, forecast)
        if self._detour is not None:
            self._detour.update(observation, scene)
            forecast = self._detour.cleared(scene, forecast)
        road = situation(scene, forecast, max_speed=MAX_SPEED, curve=CURVE_LATERAL, braking=CURVE_BRAKING)
        if self._detour is not None:
            road = self._detour.applied(road, LINE_GAP_M)
            model = PASSING_MODEL if self._detour.passing else MODEL
        return road, model

    def _eased(self, demand: float, speed: float) -> float:
        """Demanded acceleration, changed by no more than comfort allows within a second."""
        if speed < STANDING:
            self._asked.clear()
        if self._asked:
            demand = min(max(demand, max(self._asked) - MOST_CHANGE), min(self._asked) + MOST_CHANGE)
        self._asked.append(demand)
        return demand

    def _in_danger(self, best: int, speed: float) -> bool:
        """Whether even the best proposal collides, nearly does, or leaves the road, too soon."""
        meets = bool(self._scores[best, MET_AT] <= EMERGENCY_S)
        if self._looks_ahead:
            meets |= bool(self._scores[best, SHORT_AT] <= SHORT_S)
        if not self._careful:
            return meets and speed <= PUBLISHED_SPEED
        return meets or bool(self._scores[best, OFF_AT] <= EMERGENCY_S and speed > MOVING)

    def _best(self) -> int:
        """The highest score; among equals the one on the centreline, then the slowest where all are bad."""
        totals, beside = self._scores[:, TOTAL], np.arange(PROPOSALS) >= len(FACTORS)
        fails_at = np.minimum(self._scores[:, [MET_AT, OFF_AT]].min(axis=1), 1e3)
        if self._detour is not None and self._detour.passing:  # room was judged for the way round alone
            totals, fails_at = np.where(beside, 0.0, totals), np.where(beside, -1.0, fails_at)
        elif self._detour is not None and self._detour.returning:
            totals = totals - RETURN_BONUS * beside
        if totals.max() <= 0.0:  # whichever fails last; the slower among equals
            return int(np.argmax(fails_at))
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
