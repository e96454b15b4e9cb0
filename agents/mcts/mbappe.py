"""MBAPPE: plans every tick by a tree search in an inner simulator, guided by a prior.

Source: Chekroun, Gilles, Toromanoff, Hornauer, Moutarde, "MBAPPE: MCTS-Built-Around Prediction for Planning
Explicitly", 2023, and the thesis of R. Chekroun, chapter 5.
"""

from __future__ import annotations

import math
import time
from typing import Annotated, Any

import numpy as np

from dohyo.agents.experts.detour import Detour
from dohyo.agents.mcts.caution import cautious
from dohyo.agents.mcts.config import (
    ACTIONS,
    CURVE_BRAKING,
    CURVE_LATERAL,
    EMERGENCY_BRAKING,
    EMERGENCY_S,
    HARDEST,
    HORIZON_S,
    LARGEST,
    LARGEST_PASSING,
    LATERAL_LIMIT,
    LATERAL_MASK,
    LET_GO,
    MAX_SPEED,
    MIDDLE,
    PERFECT_BONUS,
    SWERVING_M_S,
    Rules,
    Settings,
    rules,
)
from dohyo.agents.mcts.explanation import explain_search
from dohyo.agents.mcts.predicting import make_predictor
from dohyo.agents.mcts.prior import kernel, learned_actions
from dohyo.agents.mcts.simulator import FAILED, REACH_M, SPEED, STANDING, STATE, controls
from dohyo.agents.mcts.tree import BEST_LEAF, PAIRS, Beliefs, best_child, make_tree, search, start
from dohyo.agents.mcts.value.mlp import load_value, no_value
from dohyo.agents.planning.motion import Idm, body, limited_steering, project, pursuit
from dohyo.agents.planning.prediction import Forecast
from dohyo.agents.planning.scene import SENSORS, Scene, SceneBuilder
from dohyo.agents.planning.situation import ROAD_BIT, Situation, box_on_grid, situation
from dohyo.agents.planning.warm_up import empty_road
from dohyo.evaluation.agent import Agent, AgentSpec, Explanation, Mission, Observation
from dohyo.evaluation.settings import FieldsOf
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import InvalidInputError

CRAFTED_IDM = Idm(gap=2.0, headway=1.2, acceleration=1.5, braking=2.0, exponent=4.0, least_gap=0.1, hardest=3.0)
_CHOICES = {"visits": 0, "q": 1, "best": 2}
_CHUNK = 16


class Mbappe(Agent):
    """Planner; its settings are the fields of `config.Settings`.

    The same settings, seed and observations give the same actions, except with `budget_ms`.

    Raises:
        InvalidInputError: The walks of a search cannot be compared as the settings ask for.
    """

    spec = AgentSpec(name="mbappe", track="privileged", sensors=SENSORS, control="acceleration_steering")

    def __init__(self, **settings: Annotated[Any, FieldsOf(Settings)]) -> None:
        self.settings = s = Settings(**settings)
        if s.walks == "node" and (s.choice == "best" or s.value == "network"):
            raise InvalidInputError(
                f"walks 'node' end at different depths: expected choice 'visits' or 'q' and value 'none', "
                f"got '{s.choice}' and '{s.value}'"
            )
        self.rules = rules(self.settings)
        self._aside = self.rules.aside
        self.predictor = make_predictor(self.settings.predictor)
        self._vehicle = VehicleParameters()
        self.car = body(self._vehicle, LATERAL_LIMIT if self.settings.simulator == "ours" else LATERAL_MASK)
        self.tree = make_tree(self.settings.simulations, self.rules.depth)
        self._kernel = kernel(self.settings.prior_variance)
        self._value = load_value() if self.settings.value == "network" else no_value()
        self.builder = SceneBuilder()
        self._detour = Detour(self.car.length, self.car.width) if self.settings.passing else None
        self._forget(seed=0)

    def warm_up(self) -> None:
        """Decides on an empty road."""
        Detour.warm_up()
        self.act(empty_road(self.spec.sensors))

    def reset(self, mission: Mission, seed: int) -> None:
        """Clears the state of the last episode."""
        self.builder.reset()
        if self._detour is not None:
            self._detour.reset()
        self._forget(seed)

    def close(self) -> None:
        """Nothing to free."""

    def _forget(self, seed: int) -> None:
        order = np.random.default_rng(seed).permutation(PAIRS)
        self._order: IntArray = np.ascontiguousarray(order, dtype=np.int64)
        self._last = np.array([MIDDLE, MIDDLE], dtype=np.int64)
        self._plan: IntArray = np.full(self.rules.depth, -1, dtype=np.int64)
        self._demand = 0.0
        self._why: dict[str, Any] = {}
        self.scene: Scene | None = None
        self.road: Situation | None = None

    def act(self, observation: Observation) -> np.ndarray:
        """First 0.1 s of the best plan: acceleration, and steering as a share of full lock."""
        scene = self.builder.update(observation)
        if self._detour is not None:
            self._detour.update(observation, scene)
        self.rules = self._rules_of(scene.ego.speed)
        road, state, forecast = self.look(scene)
        decision = self.decide(road, state, forecast)
        demand, wheel = self._command(road, state, decision)
        # An emergency's brakes are released faster than comfort allows, down to the hardest action's.
        self._demand = demand if demand >= -HARDEST else min(demand + LET_GO, -HARDEST)
        return np.array([demand, wheel / self._vehicle.max_steering])

    def _rules_of(self, speed: float) -> Rules:
        """More of both actions while the ego passes something; slowly, or on its way back, it may leave its lane."""
        detour = self._detour
        passing, returning = (False, False) if detour is None else (detour.passing, detour.returning)
        free = passing or returning or speed < SWERVING_M_S
        return self.rules._replace(
            largest=LARGEST_PASSING if passing else LARGEST, aside=MIDDLE if free else self._aside
        )

    def look(self, scene: Scene) -> tuple[Situation, FloatArray, Forecast]:
        """Situation of a scene, the ego's state in it, and the forecast; passing as judged at the last `act`."""
        forecast = self.predictor.predict(scene)
        others = cautious(scene, forecast.actors) if self.settings.caution else forecast.actors
        if self._detour is not None:
            others = self._detour.cleared(scene, others)
        road = situation(scene, others, max_speed=MAX_SPEED, curve=CURVE_LATERAL, braking=CURVE_BRAKING)
        if self._detour is not None:
            road = self._detour.applied(road, self.rules.line_gap)
        self.scene, self.road = scene, road
        return road, self._root(scene, road), forecast

    def explain(self) -> Explanation | None:
        """The tree: nodes with Q, N, P, the terms of the reward and the trajectory; see `explanation`."""
        if self.road is None or self.scene is None:
            return None
        search = explain_search(self.tree, self.road, self.car, self.rules)
        return {"agent": self.spec.name, **self._why, **search}

    def decide(self, road: Situation, state: FloatArray, forecast: Forecast) -> tuple[int, int] | None:
        """First action, as indices; None if no plan is safe, so that the ego should stop."""
        s = self.settings
        trajectory = forecast.ego if s.prior in ("learned", "both") else None
        beliefs = Beliefs(
            kernel=self._kernel,
            learned=learned_actions(trajectory, road, self.car, self.rules, s.learned_prior_s),
            order=self._order,
            plan=self._plan,
            last=self._last,
            draws=self._draws(),
            value=self._value,
        )
        until = math.inf if s.budget_ms is None else time.perf_counter() + s.budget_ms / 1000.0
        ran, chain = self._plan_from(road, beliefs, state, until)
        if s.emergency and self._danger(chain) and s.constraints in ("tree", "both"):
            # Continuity leaves no safe plan: search again as if the ego had been braking.
            self._last[0], self._plan[:] = 0, -1
            more, chain = self._plan_from(road, beliefs, state, until)
            ran += more
        self._why = {"simulations": ran, "nodes_made": int(self.tree.numbers[0]), "plan": [int(node) for node in chain]}
        if s.reuse:
            self._plan[:] = -1
            waits = max(state[SPEED], self.tree.state[chain[0], SPEED]) < STANDING
            if not (waits and s.drives_off):
                left = chain[1:] if self.rules.hold_steps == 1 else chain  # an action of one tick is over at the next
                self._plan[: len(left)] = self.tree.action[left]
        action = int(self.tree.action[chain[0]])
        self._last[:] = action // ACTIONS, action % ACTIONS
        danger = self._danger(chain)
        self._why |= {"emergency": danger, "action": [int(i) for i in self._last]}
        if s.emergency and danger:
            self._last[:] = 0, MIDDLE
            return None
        return int(self._last[0]), int(self._last[1])

    def _plan_from(self, road: Situation, beliefs: Beliefs, state: FloatArray, until: float) -> tuple[int, list[int]]:
        """Searches from a state until a time; number of simulations, and nodes of the plan."""
        start(self.tree, road, self.car, self.rules, CRAFTED_IDM, beliefs, state)
        ran = self._search(road, beliefs, until)
        return ran, self._chain()

    def _draws(self) -> FloatArray:
        return np.zeros(0)

    def _search(self, road: Situation, beliefs: Beliefs, until: float) -> int:
        s, arguments = self.settings, (self.tree, road, self.car, self.rules, CRAFTED_IDM, beliefs)
        if until == math.inf:
            return int(search(*arguments, s.simulations, s.early_stop))
        ran = 0
        while ran < s.simulations and (ran == 0 or time.perf_counter() < until):
            ran += int(search(*arguments, min(_CHUNK, s.simulations - ran), s.early_stop))
            if self.tree.numbers[1]:
                break
        return ran

    def _chain(self) -> list[int]:
        """Nodes of the plan, from the first action on."""
        choice, chain, node = _CHOICES[self.settings.choice], [], 0
        if choice == 2:
            node = int(self.tree.numbers[BEST_LEAF])
            while node > 0:
                chain.append(node)
                node = int(self.tree.parent[node])
            return chain[::-1]
        while (node := int(best_child(self.tree, node, choice, PERFECT_BONUS))) >= 0:
            chain.append(node)
        return chain

    def _danger(self, chain: list[int]) -> bool:
        """Whether the plan fails too soon to wait for a better one."""
        last = chain[-1]
        within = int(self.tree.depth[last]) * self.settings.hold_s <= max(EMERGENCY_S, self.settings.hold_s)
        return bool(self.tree.outcome[last] == FAILED and within)

    def _root(self, scene: Scene, road: Situation) -> FloatArray:
        ego, state = scene.ego, np.zeros(STATE)
        if ego.speed < STANDING:  # brakes held while standing are released at once
            self._demand = 0.0
        on_road = box_on_grid(road.grid, 0.0, 0.0, 1.0, 0.0, 0.5 * self.car.length, 0.5 * self.car.width) & ROAD_BIT
        state[:] = (
            -self.car.axle, 0.0, 0.0, ego.speed, ego.acceleration, ego.steering, self._demand, 0.0,
            project(road.path, road.first_s, road.spacing, 0.0, 0.0, 0.0, REACH_M)[1], 0.0 if on_road else 1.0,
        )  # fmt: skip
        return state

    def _command(self, road: Situation, state: FloatArray, decision: tuple[int, int] | None) -> tuple[float, float]:
        """Acceleration [m/s^2] and wheel angle [rad] of the next 0.1 s."""
        rules = self.rules
        if decision is not None:
            target = (decision[0] - MIDDLE) * rules.acceleration_step
            lateral = (decision[1] - MIDDLE) * rules.steering_step
            demand, wheel = controls(road, self.car, rules, state, target, lateral)
            return float(demand), float(wheel)
        x, y, heading, speed = (float(v) for v in state[:4])
        wheel = pursuit(self.car, road.path, road.first_s, road.spacing, x, y, heading, speed, 0.0, 0.0)
        return -EMERGENCY_BRAKING, float(limited_steering(self.car, speed, wheel))


__all__ = ["HORIZON_S", "Mbappe"]
