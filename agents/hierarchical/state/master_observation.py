"""The master's observation: state, options that may begin, and whether the running one is finished."""

from __future__ import annotations

import numpy as np

from dohyo.agents.hierarchical.options.actuation import Steering, command
from dohyo.agents.hierarchical.options.manoeuvres import CHANGES, Course, Manoeuvre, learned, light_ahead
from dohyo.agents.hierarchical.state.state import StateConfig, StateEncoder
from dohyo.agents.planning.surroundings import Surroundings, warm_up
from dohyo.agents.planning.warm_up import empty_road
from dohyo.agents.rules.facts import SENSORS
from dohyo.agents.rules.rules_only import RulesOnly
from dohyo.agents.safety.line_monitor import LineMonitor
from dohyo.evaluation.agent import Mission, Observation
from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray

OPTIONS = tuple(Manoeuvre)
FINISHED, CRITICAL, FRESH = range(3)
FLAGS = 3
HOLD: FloatArray = np.array([-2.0, 0.0])
"""Action while the filter needs the vehicle to stand."""


class MasterObservation:
    """Follows one episode.

    Attributes:
        encoder: Makes the states.
        rules: Rules that drive in critical situations; None: they never drive.
        sensors: Needed in an observation.
        seen: The last observation, along the path that is followed.
        believed: The same from the estimated pose.
        around: Made of `seen`.
        state: Of the last observation.
        available: (options,) options that may begin now.
        finished: Whether the running option has reached its goal.
    """

    def __init__(self, state: StateConfig, rules: RulesOnly | None = None, lines: bool = True) -> None:
        """Loads the state's encoder.

        Args:
            state: Configuration of the state.
            rules: Drive in critical intervals.
            lines: Whether an interval before a closed line is critical, too.
        """
        self.encoder, self.rules = StateEncoder(state), rules
        self._lines, self._knows_lines = LineMonitor(), lines
        self.sensors = tuple(dict.fromkeys((*SENSORS, *self.encoder.sensors)))
        self.seen: Observation = {}
        self.believed: Observation = {}
        self._forget()

    def warm_up(self) -> None:
        """Observes an empty road; `reset` must follow."""
        warm_up()
        self.encoder.warm_up()
        if self.rules is not None:
            self.rules.warm_up()
        self.update(empty_road(self.sensors))

    def reset(self, mission: Mission, seed: int) -> None:
        """Begins an episode."""
        self.encoder.reset()
        if self.rules is not None:
            self.rules.reset(mission, seed)
        self._forget()

    def _forget(self) -> None:
        self.state: Float32Array = np.zeros(self.encoder.size, dtype=np.float32)
        self.available: BoolArray = np.zeros(len(OPTIONS), dtype=np.bool_)
        self.finished, self._fresh, self._ticks = False, True, 0
        self._course, self._was_critical = Course(), False
        self._lines.reset()
        self._followed: Manoeuvre | None = None

    @property
    def critical(self) -> bool:
        """Whether the rules drive."""
        before_line = self._knows_lines and self._lines.critical
        return self.rules is not None and (self.rules.watch.critical or before_line)

    @property
    def offset(self) -> float:
        """Offset of the path, m to the left of the route."""
        return self._course.offset

    def update(self, observation: Observation) -> None:
        """Updates by one tick.

        Args:
            observation: With `sensors`.
        """
        self._fresh, self._ticks = self._ticks == 0, self._ticks + 1
        along_route = Surroundings(observation)
        speed, progress = float(observation["speedometer"][0]), float(observation["navigation"][2])
        self._course.look(along_route)
        self._course.keep_to_roads(progress, speed)
        self.seen = self._course.seen(observation)
        self.around = along_route if self.seen is observation else Surroundings(self.seen)
        located = self.encoder.located(observation)
        self.believed = self.seen if located is observation else self._course.seen(located)
        self.state = self.encoder.encode(self.believed)
        may = learned(self.seen, self.around)
        room = {change: self._course.free(change, speed) for change in CHANGES}
        self.available = np.array([one in may and room.get(one, True) for one in OPTIONS])
        self.finished = self._is_finished(observation)
        self._speed, self._progress = speed, progress
        self._was_critical = self.critical
        if self.rules is not None:
            self.rules.observe(self.seen)
            self._lines.update(speed, self.seen["junctions_ahead"])

    def follow(self, option: Manoeuvre) -> None:
        """Sets the path of an option; must be called in every tick that the option drives."""
        if option in CHANGES and (option is not self._followed or self.finished):
            self._course.begin(option, self._progress, self._speed)
        self._followed = option

    def controls(self, action: Float32Array, steering: Steering) -> FloatArray:
        """Controls of an option: acceleration [m/s^2] and steering in [-1, 1] of full lock.

        Args:
            action: (2,) in [-1, 1], see `actuation.command`.
            steering: Kind of steering.
        """
        if self.encoder.calibrating:
            return HOLD
        return command(action, float(self.seen["speedometer"][0]), self.believed["route"], steering)

    def obey_rules(self) -> FloatArray:
        """Controls of the rules: acceleration [m/s^2] and steering in [-1, 1] of full lock."""
        assert self.rules is not None
        if not self._was_critical:
            self.rules.take_over()
        return self.rules.decide(self.seen)

    def vector(self) -> Float32Array:
        """(size + options + FLAGS,) the outlook as one observation of an environment."""
        flags = (self.finished, self.critical, self._fresh)
        return np.concatenate([self.state, self.available, flags], dtype=np.float32)

    def _is_finished(self, observation: Observation) -> bool:
        if self._followed in CHANGES:
            return self._course.arrived(observation)
        return self._followed is Manoeuvre.LIGHTS and not light_ahead(observation["junctions_ahead"])
