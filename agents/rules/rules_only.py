"""Rules only: drives by answer sets. GHRL falls back on it in critical situations.

Each tick the observation becomes facts, the rules order actions, and the control below them carries these out: pure
pursuit of the route, IDM behind leaders and before lines, the levels of the braking cascade, and
smooth ramps into the lane beside and back.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np

from dohyo.agents.planning.motion import Idm
from dohyo.agents.planning.sidestep import Sidestep
from dohyo.agents.planning.surroundings import Surroundings, warm_up
from dohyo.agents.planning.warm_up import empty_road
from dohyo.agents.rules.facts import SENSORS, WAITS_M_S, FactsBuilder, Memory, Moment
from dohyo.agents.rules.rulebook import RuleError, Signature, read_rulebook
from dohyo.agents.rules.solver import Decision, Solver
from dohyo.agents.safety.rss import CONSTANTS
from dohyo.agents.safety.rss_monitor import RssMonitor
from dohyo.evaluation.agent import Agent, AgentSpec, Explanation, Mission, Observation
from dohyo.evaluation.settings import OneOf
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.ego.control import pure_pursuit, pursuit_distance
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import UnknownNameError

RULES = Path(__file__).with_name("programs")
MAX_SPEED_M_S = 14.0
CURVE_M_S2 = 2.0
SLOWING_M_S2 = 1.75
FOLLOWING = Idm(gap=2.5, headway=1.3, acceleration=2.0, braking=2.5, exponent=4.0, least_gap=0.05, hardest=5.0)
PASSING_M_S2 = 3.0
LINE_GAP_M = 1.0
LEVELS_M_S2 = (0.0, 1.5, 2.5, 4.0, 6.0, 8.0)
"""Decelerations of the braking cascade, by `brake(L)`, m/s^2."""
HARDEST_M_S2 = 8.0
ORDERS = {
    *(Signature(name, 1) for name in ("pace", "follow", "waits", "stop", "brake", "change")),
    *(Signature(name, 0) for name in ("go", "keep_lane", "keep_right")),
}
"""Orders that the control below the rules can execute."""
SIDE_M_S2 = 3.0
LEAST_RAMP_M, BACK_RAMP_M, RIGHT_RAMP_M = 6.0, 12.0, 8.0


class RulesOnly(Agent):
    """See the module."""

    spec = AgentSpec(name="rules", track="privileged", sensors=SENSORS, control="acceleration_steering")

    def __init__(self, rules: str | Path = RULES, rss: Annotated[str, OneOf(CONSTANTS)] = "rss") -> None:
        """Reads the rules.

        Args:
            rules: Folder of the rulebook.
            rss: A name of `rss.CONSTANTS`.

        Raises:
            RuleError: The rulebook cannot be used.
            UnknownNameError: There are no such constants.
        """
        if rss not in CONSTANTS:
            raise UnknownNameError("RSS constants", rss, CONSTANTS)
        book = read_rulebook(Path(rules))
        for action, place in book.actions.items():
            if action not in ORDERS:
                known = ", ".join(sorted(map(str, ORDERS)))
                raise RuleError(f"{place}: expected an order of {known}, got '{action}'")
        self.solver, self.files = Solver(book), book.files
        self.watch = RssMonitor(CONSTANTS[rss])
        self._vehicle = VehicleParameters()
        self._builder = FactsBuilder()
        self._forget()

    def warm_up(self) -> None:
        """Observes an empty road; a decision on it could change the solver's later choices among equals."""
        warm_up()
        self.observe(empty_road(self.spec.sensors))

    def reset(self, mission: Mission, seed: int) -> None:
        """Clears the state of the last episode."""
        self.watch.reset()
        self._forget()

    def _forget(self) -> None:
        self._memory, self._aside = Memory(), Sidestep()
        self._decision: Decision | None = None
        self._waits, self._right = False, 0.0

    def act(self, observation: Observation) -> np.ndarray:
        """Controls for the orders of the rules."""
        self.observe(observation)
        return self.decide(observation)

    def observe(self, observation: Observation) -> None:
        """Updates memory and RSS by one tick without a decision, for agents that use the rules at times.

        An ego that has to wait by the last decision goes on waiting until it drives.
        """
        speed = float(observation["speedometer"][0])
        self._waits = self._waits and speed < WAITS_M_S
        self._memory.wait(speed, self._waits)
        self._around = Surroundings(observation)
        self._memory.watch(observation, self._around.neighbours)
        self.watch.update(observation, self._around)

    def take_over(self) -> None:
        """Starts on the given path, independent of the last decision."""
        self._aside, self._right = Sidestep(), 0.0

    def decide(self, observation: Observation) -> np.ndarray:
        """Controls for the orders of the rules; after `observe` of the same observation."""
        speed, progress = float(observation["speedometer"][0]), float(observation["navigation"][2])
        route = self._aside.applied(observation["route"], progress)
        advised = advised_speed(route)
        moment = self._builder.moment(observation, self._around, self._memory, self._aside, self.watch.dangers, advised)
        self._decision = decision = self.solver.decide(moment.facts)
        self._waits = bool(decision.orders("waits"))
        self._change_lane(decision, moment, speed, progress)
        route = self._aside.applied(observation["route"], progress)
        aim = route[round(pursuit_distance(speed))]
        steering = pure_pursuit(self._vehicle, float(aim[0]), float(aim[1])) / self._vehicle.max_steering
        return np.array([self._acceleration(decision, moment, speed, advised), steering])

    def explain(self) -> Explanation | None:
        """Facts, answer set and fired rules of the last decision, and the result of RSS."""
        if self._decision is None:
            return None
        return {"agent": self.spec.name, **self.solver.explanation(self._decision), "rss": self.judgement()}

    def close(self) -> None:
        """Does nothing: the agent has no resources."""

    def judgement(self) -> Explanation:
        """Result of RSS for the last tick, and totals of the critical intervals."""
        return {
            "critical": self.watch.critical,
            "critical_share": round(self.watch.share, 4),
            "longest_standing_s": round(self.watch.longest_standing_s, 1),
            "dangers": [danger.as_json() for danger in self.watch.dangers],
        }

    def _acceleration(self, decision: Decision, moment: Moment, speed: float, advised: float) -> float:
        """Smallest acceleration that the actions request, m/s^2."""
        paces = [v / 10.0 for v in decision.numbers("pace")]
        most = FOLLOWING.acceleration if self._aside.offset in (0.0, self._right) else PASSING_M_S2
        wish = _towards(speed, min([advised, *paces]), most)
        for key in decision.numbers("follow"):
            if key not in moment.ahead:
                raise RuleError(f"order 'follow({key})': expected the key of an actor ahead, of {sorted(moment.ahead)}")
            gap, pace = moment.ahead[key]
            wish = min(wish, follow(speed, gap, max(pace, 0.0)))
        for distance in decision.numbers("stop"):
            wish = min(wish, follow(speed, distance / 10.0 + FOLLOWING.gap - LINE_GAP_M, 0.0))
        level = min(max([0, *decision.numbers("brake")]), len(LEVELS_M_S2) - 1)
        return max(min(wish, -LEVELS_M_S2[level]) if level else wish, -HARDEST_M_S2)

    def _change_lane(self, decision: Decision, moment: Moment, speed: float, progress: float) -> None:
        for where in decision.names("change"):
            if where == "own":
                ramp = speed * math.sqrt(6.0 * abs(self._aside.offset) / SIDE_M_S2)
                if self._aside.offset != 0.0:
                    self._aside.back(progress, max(ramp, BACK_RAMP_M))
                return
            if where not in moment.lanes:
                raise RuleError(f"order 'change({where})': expected own, or a lane beside, of {sorted(moment.lanes)}")
            offset, nearest = moment.lanes[where], min(gap for gap, _ in moment.ahead.values())
            ramp = max(speed * math.sqrt(6.0 * abs(offset) / SIDE_M_S2), LEAST_RAMP_M)
            ramp = min(ramp, max(nearest - 1.0, LEAST_RAMP_M))
            self._aside.lead(offset, progress + max(nearest - 1.0 - ramp, 0.0), ramp)
            self._right = 0.0
            return
        self._keep_right(moment.squeeze if decision.orders("keep_right") else 0.0, progress)

    def _keep_right(self, offset: float, progress: float) -> None:
        """Moves to the right inside the ego's own lane, and back; only while it is in that lane."""
        if self._aside.offset not in (0.0, self._right):
            return
        if offset < self._right - 0.05 or (offset == 0.0 and self._right < 0.0):
            self._right = offset
            self._aside.lead(offset, progress, RIGHT_RAMP_M)


def advised_speed(route: Float32Array) -> float:
    """Highest present speed from which gentle braking meets every limit and curve ahead, m/s.

    Args:
        route: (80, 7), see `sensors.route`.
    """
    curve = np.sqrt(CURVE_M_S2 / np.maximum(np.abs(route[:, 3]), 1e-3))
    allowed = np.minimum(np.minimum(route[:, 4], curve), MAX_SPEED_M_S)
    ahead = np.arange(len(route), dtype=np.float64)
    return float(np.sqrt(allowed**2 + 2 * SLOWING_M_S2 * ahead).min())


def follow(speed: float, gap: float, pace: float) -> float:
    """IDM's acceleration behind a leader, m/s^2: gap [m] between bumpers, its speed [m/s]."""
    s = FOLLOWING
    gap = max(gap, s.least_gap)
    closing = speed * (speed - pace) / (2 * math.sqrt(s.acceleration * s.braking))
    wanted = s.gap + max(0.0, speed * s.headway + closing)
    return max(s.acceleration * (1.0 - (wanted / gap) ** 2), -s.hardest)


def _towards(speed: float, target: float, most: float) -> float:
    if speed > target:
        return max((target - speed) / 0.5, -4.0)
    return most * (1.0 - (speed / max(target, 0.1)) ** 4)
