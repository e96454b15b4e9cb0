"""ManoeuvreEnv: environment with one ego on the scenarios of one manoeuvre; 10 decisions per second."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from dohyo.agents.hierarchical.environments.endings import End, Endings
from dohyo.agents.hierarchical.environments.pace import Restraint, pace_of
from dohyo.agents.hierarchical.environments.rewards import Form, reward, terms
from dohyo.agents.hierarchical.environments.scenarios import draw_scenario
from dohyo.agents.hierarchical.options.actuation import action_of, command
from dohyo.agents.hierarchical.options.manoeuvres import (
    CHANGES,
    DRIVE,
    Course,
    Manoeuvre,
    deviation,
    learned,
    restraints_of,
)
from dohyo.agents.hierarchical.state.state import StateEncoder
from dohyo.agents.hierarchical.state.views import rows_seen
from dohyo.agents.learning.tasks.task import Array
from dohyo.agents.planning.surroundings import Surroundings, warm_up
from dohyo.agents.rules.facts import SENSORS
from dohyo.agents.rules.rules_only import RulesOnly
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

if TYPE_CHECKING:
    from dohyo.agents.hierarchical.training.tasks import ManoeuvreTask

EGO = "ego"
CUT_SHORT = (Manoeuvre.LANE, Manoeuvre.BRAKING)
"""Manoeuvres whose exercises end where another sub-policy takes over; lane changes are too short for that."""
JUDGED_BY: Form = "product"
"""Reward of held-out episodes for every arm, so that their returns can be compared."""
MEASURES = ("distance_m", "deviation_m", "angle_rad", "speed_m_s", "infraction", "standing")
"""Measures of an episode: the thesis's five except the reward, and its ending."""


class DrivingTaskEnv(gymnasium.Env[Array, Array]):
    """Base of exercise and journey: a scenario that is driven, judged and measured.

    Attributes:
        what: A `Manoeuvre`, or "drive".
        seen: The last observation, along the path that is followed.
    """

    def __init__(self, what: str, sensors: tuple[str, ...], form: Form) -> None:
        """Compiles the kernels; the simulation starts at `reset`."""
        warm_up()
        self.what, self._form = what, form
        self._sensors = tuple(dict.fromkeys((*SENSORS, *sensors)))
        self._restraints, self._all = restraints_of(what), frozenset(Restraint)
        self._driving: DrivingEnv | None = None
        self.seen: Observation = {}

    @property
    def driving(self) -> DrivingEnv:
        """The simulation.

        Raises:
            SimulationError: It has not been reset.
        """
        if self._driving is None:
            raise SimulationError(f"'{self.what}': the environment has not been reset")
        return self._driving

    def close(self) -> None:
        """Ends the simulation."""
        if self._driving is not None:
            self._driving.close()
            self._driving = None

    def _begin(self, seed: int) -> Observation:
        """Begins the scenario of a seed; the first observation."""
        self.close()
        self._judged_by = JUDGED_BY if seed >= HELD_OUT_FROM else self._form
        self._driving = DrivingEnv(draw_scenario(self.what, seed), self._sensors, "acceleration_steering", reward=None)
        observations, _ = self._driving.reset()
        self._endings, self._tally = Endings(self.what, self._driving.world), _Tally()
        observation: Observation = observations[EGO]
        return observation

    def _tick(self, controls: FloatArray) -> Observation:
        """Drives one tick; the observation."""
        self._before = self.driving.world
        observations, _, reached, late, _ = self.driving.step({EGO: controls})
        self._reached, self._late = reached[EGO], late[EGO]
        observation: Observation = observations[EGO]
        return observation

    def _judge(self, around: Surroundings, arrived: bool) -> tuple[float, bool, bool, dict[str, Any]]:
        """Reward, ends and info of the last tick, along `seen`."""
        after = self.driving.world
        lateral, angle = deviation(self.seen["path"])
        speed = float(after.egos.speed[0])
        lawful, own = pace_of(self.seen, around, self._all), pace_of(self.seen, around, self._restraints)
        if self.what in CUT_SHORT:  # at a task of another sub-policy, the exercise is complete
            self._reached |= self.what not in learned(self.seen, around)
        out = self._reached or self._late
        end = self._endings.update(self._before, after, lateral, lawful.held, arrived, out)
        value = reward(terms(speed, own, lateral, angle), end is End.INFRACTION, self._judged_by)
        self._tally.add(float(after.egos.driven[0]), lateral, angle, speed)
        if end is None:
            return value, False, False, {}
        terminated = end in (End.INFRACTION, End.STANDING)
        return value, terminated, not terminated, self._tally.info(end, self._succeeded(end))

    def _succeeded(self, end: End) -> bool:
        """Whether the manoeuvre is complete; for plain driving, whether the end is reached."""
        if end is End.TIME:
            return self.what == Manoeuvre.LANE or (self._reached and self.what in (Manoeuvre.BRAKING, DRIVE))
        return end is End.DONE


class ManoeuvreEnv(DrivingTaskEnv):
    """Environment of one sub-policy, with the rules as expert."""

    def __init__(self, task: ManoeuvreTask) -> None:
        """Makes the environment.

        Args:
            task: Learning problem.

        Raises:
            InvalidInputError: The state uses a filter's pose: filters are calibrated standing, exercises start rolling.
        """
        if task.state.localization != "truth":
            raise InvalidInputError(
                f"{task.name}: expected localization 'truth', got '{task.state.localization}': "
                "exercises start rolling, and filters are calibrated standing"
            )
        self._encoder = StateEncoder(task.state)
        super().__init__(task.what, self._encoder.sensors, task.form)
        self.observation_space, self.action_space = task.observation_space, task.action_space
        self._steering, self._rows = task.steering, rows_seen(self._encoder, task.what)
        self._rules: RulesOnly | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begins the scenario of a seed."""
        observation = self._begin(seed or 0)
        self._encoder.reset()
        self._course, self._begun, self._advised = Course(), False, False
        return self._look(observation), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Drives one tick.

        Args:
            action: (2,) in [-1, 1], see `actuation.command`.

        Raises:
            SimulationError: It has not been reset.
        """
        speed, route = float(self.seen["speedometer"][0]), self.seen["route"]
        state = self._look(self._tick(command(action, speed, route, self._steering)))
        return state, *self._judge(self._around, self._arrived)

    def expert_action(self) -> Float32Array:
        """Action of the rules; must be called in every tick of an episode, or in none."""
        if not self._advised:
            self._rules, scenario = self._rules or RulesOnly(), self.driving.scenario
            self._rules.reset(scenario.missions[0], scenario.seed)
            self._advised = True
        assert self._rules is not None
        controls = self._rules.act({name: self.seen[name] for name in SENSORS})
        return action_of(controls, float(self.seen["speedometer"][0]), self.seen["route"], self._steering)

    def _look(self, observation: Observation) -> Float32Array:
        """State, after the path has been set by the manoeuvre."""
        around = Surroundings(observation)
        if self.what in CHANGES and not self._begun:
            speed, progress = float(observation["speedometer"][0]), float(observation["navigation"][2])
            manoeuvre = Manoeuvre(self.what)
            self._course.look(around)
            if self._course.free(manoeuvre, speed):
                self._begun = self._course.begin(manoeuvre, progress, speed)
        self._arrived = self._begun and self._course.arrived(observation)
        self.seen = self._course.seen(observation)
        self._around = around if self.seen is observation else Surroundings(self.seen)
        return self._encoder.encode(self.seen)[self._rows]


class _Tally:
    """Accumulates the measures of an episode."""

    def __init__(self) -> None:
        self._ticks, self._distance = 0, 0.0
        self._sums = np.zeros(3)

    def add(self, driven: float, lateral: float, angle: float, speed: float) -> None:
        self._ticks, self._distance = self._ticks + 1, driven
        self._sums += abs(lateral), abs(angle), speed

    def info(self, end: End, success: bool) -> dict[str, Any]:
        means = self._sums / max(self._ticks, 1)
        numbers = (self._distance, *means.tolist(), float(end is End.INFRACTION), float(end is End.STANDING))
        return {"success": success, "end": end.value, **dict(zip(MEASURES, numbers, strict=True))}
