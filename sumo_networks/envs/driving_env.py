"""DrivingEnv: a scenario as a PettingZoo environment with any number of egos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from dohyo.sumo_networks.actors.external import ExternalActors
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.conditions import conditions_named
from dohyo.sumo_networks.ego.control import Control, InvalidActionError, make_control
from dohyo.sumo_networks.ego.pose import WORLD_CONTROLS, Pose, PoseControl
from dohyo.sumo_networks.envs.options import (
    DEFAULT_SENSORS,
    RENDERING,
    SensorNames,
    by_ego,
    check_names,
    check_render_mode,
    check_reward,
    check_scenario,
    checked_sensors,
    own_space,
)
from dohyo.sumo_networks.envs.reward import Reward, make_reward
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError, UnknownNameError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.rendering.overhead import Overhead
from dohyo.sumo_networks.routes.route import Route
from dohyo.sumo_networks.rules.episode_end import is_late, is_played_out, reached_goal
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.seeds import HELD_OUT_FROM, episode_seed
from dohyo.sumo_networks.sensors import Observation, Sensor, Track, make_sensors
from dohyo.sumo_networks.simulation import Replay, Simulation, plan_scenario, start_simulation
from dohyo.sumo_networks.simulation.process import RunsOnce
from dohyo.sumo_networks.simulation.traffic_log import LogRecorder
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import Actors, World

Step = tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]
"""Observations, rewards, terminations, truncations and infos by the egos' names."""
SENSOR_NOISE = 1  # separates this stream of random numbers from the traffic's


class DrivingEnv(RunsOnce, ParallelEnv):  # type: ignore[misc]
    """A scenario whose egos follow actions, 10 per second.

    An ego's episode terminates at its goal or when its reward function says so. It is truncated when more time has
    passed than the time limit allows, or when the scenario's duration is over. The ego then leaves the road. There can
    be one started environment per process, since libsumo is global; it can be copied and pickled only before `reset`
    and after `close`.

    Attributes:
        render_mode: "rgb_array" or None.
        scenario: The simulated scenario.
        possible_agents: Names of the missions.
        agents: Names of the egos still driving.

    Source: PettingZoo's ParallelEnv interface.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "dohyo_driving_v0", "is_parallelizable": True, **RENDERING}

    def __init__(
        self,
        scenario: Scenario,
        sensors: SensorNames | Mapping[str, SensorNames] = DEFAULT_SENSORS,
        control: str | Mapping[str, str] = "target_speed_steering",
        reward: str | None = "roach",
        render_mode: str | None = None,
        new_seeds: bool = False,
    ) -> None:
        """Plans the routes and checks every name; SUMO starts at `reset`.

        Args:
            scenario: The scenario to simulate.
            sensors: Names from `sensors.SENSORS` or sensor configurations, for all egos or by ego name.
            control: Name from `control.CONTROLS`, for all egos or by ego name.
            reward: Name from `reward.REWARDS`; None: rewards are 0 and only the goal terminates.
            render_mode: "rgb_array" for pictures from `render`.
            new_seeds: Whether a reset without a seed draws a new one below 2^30. It follows from the last seed given,
                and is random before one was given, also to a copy. By default such a reset repeats the last seed.

        Raises:
            InvalidInputError: It is no scenario, a name is unknown, an ego has no sensors or control, or a time limit
                or mission is impossible.
        """
        check_render_mode(render_mode)
        check_scenario(scenario)
        self.render_mode = render_mode
        self._overhead: Overhead | None = None
        self.scenario = scenario
        self.possible_agents = [mission.name for mission in scenario.missions]
        self.agents: list[str] = []
        self._index = {name: i for i, name in enumerate(self.possible_agents)}
        self._new_seeds = new_seeds
        self._seeds: np.random.Generator | None = None
        chosen_sensors = by_ego("sensors", sensors, self.possible_agents)
        self._sensor_names = {name: checked_sensors(chosen) for name, chosen in chosen_sensors.items()}
        self._sensors = self._new_sensors()
        self._control_names = by_ego("control", control, self.possible_agents)
        check_names("control", self._control_names.values())
        check_reward(reward)
        self._reward_name = reward
        self._plan = plan_scenario(load_network(scenario.network), scenario)
        self._simulation: Simulation | Replay | None = None
        self._interrupted = False
        self._controls = self._new_controls()
        self._rewards: dict[str, Reward] = {name: make_reward(reward) for name in self.possible_agents if reward}
        self._action_spaces = {name: own_space(control.space) for name, control in self._controls.items()}
        self._observation_spaces = {
            name: gymnasium.spaces.Dict({sensor.name: own_space(sensor.space) for sensor in chosen})
            for name, chosen in self._sensors.items()
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restores a copy, whose seeds do not follow from one that was given to the original."""
        self.__dict__.update(state)
        self._seeds = None

    @property
    def network(self) -> RoadNetwork:
        """The roads, whatever has become of their file meanwhile."""
        return self._plan.network

    @property
    def routes(self) -> tuple[Route, ...]:
        """The planned routes, one per ego."""
        return self._plan.routes

    @property
    def started(self) -> bool:
        """Whether a world exists: from the first `reset` on, also after `close`."""
        return self._simulation is not None

    @property
    def open(self) -> bool:
        """Whether an episode can go on: `reset` was called, and `close` was not."""
        return self._simulation is not None and self._simulation.open

    @property
    def world(self) -> World:
        """World after the last tick.

        Raises:
            SimulationError: The environment has not been reset yet.
        """
        return self._running.world

    @property
    def _running(self) -> Simulation | Replay:
        if self._simulation is None:
            raise SimulationError(f"scenario '{self.scenario.name}' has not started; call reset() first")
        return self._simulation

    def observation_space(self, agent: str) -> gymnasium.spaces.Dict:
        """One Box per sensor.

        Raises:
            UnknownNameError: There is no such ego.
        """
        return self._observation_spaces[self._known(agent)]

    def action_space(self, agent: str) -> gymnasium.spaces.Box:
        """The control interface's space.

        Raises:
            UnknownNameError: There is no such ego.
        """
        return self._action_spaces[self._known(agent)]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Starts the scenario from its first tick.

        Args:
            seed: Seed from 0 to 2^31 - 1 that replaces the scenario's seed, also in later resets. Without one, the
                episode has the seed of the last one, and so the same traffic; with `new_seeds` it has one that follows
                from the last seed given, or a random one where none was.
            options: Unused.

        Raises:
            InvalidInputError: The seed is no whole number in that range (nothing has changed then), or the network
                cannot carry this traffic.
            SimulationError: SUMO failed, or another environment of this process is still open.
        """
        if seed is not None:
            seed = episode_seed(seed)
            self._seeds = np.random.default_rng(seed)
        elif self._new_seeds:
            drawn = self._seeds or np.random.default_rng()  # a new one each time, since processes may be forked
            seed = int(drawn.integers(HELD_OUT_FROM))
        if self._simulation is not None:
            self._simulation.close()
            self._simulation = None
        if seed is not None and seed != self.scenario.seed:
            self._plan = self._plan.with_seed(seed)
            self.scenario = self._plan.scenario
        self._sensors, self._controls = self._new_sensors(), self._new_controls()
        self._rewards = {name: make_reward(self._reward_name) for name in self._rewards if self._reward_name}
        self.agents = list(self.possible_agents)
        self._interrupted = False
        self._simulation = start_simulation(self._plan)
        return self._observe(self.agents), {name: {} for name in self.agents}

    def step(self, actions: Mapping[str, Any]) -> Step:
        """Drives every ego for one tick of 0.1 s. A step that fails or is interrupted ends the episode of all egos.

        Args:
            actions: One action per name in `agents`; actions of egos whose episode has ended are ignored.

        Returns:
            Observations, rewards, terminations, truncations and infos of the egos that drove in this tick. At the end
            of an ego's episode its infos have "success": whether it reached its goal.

        Raises:
            InvalidActionError: An action is missing, is for an unknown ego, has a wrong shape or is not finite;
                simulation and controls are then unchanged.
            SimulationError: SUMO failed, or the environment is closed, or has been interrupted since its last reset.
        """
        if not self._running.open:
            what = "was interrupted or failed in a step" if self._interrupted else "is closed"
            raise SimulationError(f"the environment of scenario '{self.scenario.name}' {what}; call reset() first")
        checked = self._checked(actions)
        try:
            return self._drive(checked)
        except BaseException:  # also KeyboardInterrupt: controls, egos and sensors may be a tick apart
            self._interrupted = True
            self._running.close()
            raise

    def _checked(self, actions: Mapping[str, Any]) -> dict[str, FloatArray]:
        """Actions of the egos that drive; all are checked before any control computes, since controls integrate."""
        if not isinstance(actions, Mapping):
            raise InvalidActionError(f"expected actions by the names of egos, got {type(actions).__name__}")
        if unknown := actions.keys() - self._index.keys():
            raise InvalidActionError(
                f"expected actions for {', '.join(self.possible_agents)}, got one for {', '.join(map(str, unknown))}"
            )
        if missing := [name for name in self.agents if name not in actions]:
            raise InvalidActionError(f"expected an action for every ego that drives, got none for {', '.join(missing)}")
        return {name: self._controls[name].checked(actions[name]) for name in self.agents}

    def _drive(self, actions: Mapping[str, FloatArray]) -> Step:
        drove, before = list(actions), self.world
        commands = np.zeros((len(self.possible_agents), 2))
        poses: dict[int, Pose] = {}
        for name, action in actions.items():
            ego = self._index[name]
            control = self._controls[name]
            commands[ego] = control.command(action, before, ego)
            if isinstance(control, PoseControl):
                poses[ego] = control.pose(action)
        self._running.tick(commands, poses)
        after = self.world
        cut = is_late(after, self.scenario.time_limit_s) or is_played_out(after, self.scenario.duration_s)
        rewards, terminations, truncations = {}, {}, dict.fromkeys(drove, cut)
        infos: dict[str, dict[str, Any]] = {}
        for name in drove:
            ego = self._index[name]
            rewards[name], ended = self._rewards[name](before, after, ego) if name in self._rewards else (0.0, False)
            arrived = reached_goal(after, ego)
            terminations[name] = ended or arrived
            infos[name] = {"success": arrived} if ended or arrived or cut else {}
        observations = self._observe(drove)
        for name in drove:
            if terminations[name] or truncations[name]:
                self.retire(name)
        return observations, rewards, terminations, truncations, infos

    def render(self) -> NDArray[np.uint8] | None:
        """(480, 480, 3) RGB picture from above, centred on the first active ego; None without a render mode."""
        if self.render_mode is None:
            return None
        if self._overhead is None:
            self._overhead = Overhead()
        driving = self.agents or self.possible_agents
        return self._overhead.frame(self.world, self._index[driving[0]])

    def check_action(self, name: str, action: object) -> None:
        """Raises InvalidActionError if an action has a wrong shape or type, or is not finite.

        Raises:
            UnknownNameError: There is no such ego.
        """
        self._controls[self._known(name)].checked(action)

    def retire(self, name: str) -> None:
        """Ends the episode of one ego and removes it from the road; one that has left stays away.

        Raises:
            UnknownNameError: There is no such ego.
        """
        ego = self._index[self._known(name)]
        if name in self.agents:
            self.agents.remove(name)
        self._running.retire(ego)

    def observe(self, name: str) -> Observation:
        """What an ego's sensors read now, also in the tick in which its episode has ended.

        Raises:
            UnknownNameError: There is no such ego.
        """
        return self._observe([self._known(name)])[name]

    def outfit(self, name: str, sensors: SensorNames, control: str) -> Observation:
        """Gives an ego other sensors and another control, as new ones at the start of an episode.

        Args:
            name: Name of the ego.
            sensors: Names or configurations of its sensors.
            control: Name from `pose.WORLD_CONTROLS`.

        Returns:
            What the new sensors read now.

        Raises:
            UnknownNameError: There is no such ego, sensor or control; nothing has changed then.
        """
        self._known(name)
        taken = make_control(control, self._plan.vehicle, TICK_S, WORLD_CONTROLS)
        made = self._made_sensors(name, sensors), taken
        self._sensors[name], self._controls[name] = made
        return self._observe([name])[name]

    @property
    def external(self) -> ExternalActors:
        """Actors of another simulator, which may be put, moved and removed between two steps.

        Raises:
            InvalidInputError: The scenario replays a log.
        """
        return self._simulated().external

    def all_actors(self) -> tuple[list[str], Actors]:
        """Names and states of all actors in the whole network, except egos and external actors.

        Raises:
            InvalidInputError: The scenario replays a log.
            SimulationError: The environment is closed.
        """
        return self._simulated().all_actors()

    def record(self, recorder: LogRecorder) -> None:
        """Adds the last tick to a log of all actors except the egos.

        Raises:
            InvalidInputError: The scenario itself replays a log.
            SimulationError: The environment is closed.
        """
        self._simulated().record(recorder)

    def _known(self, name: str) -> str:
        """The name of an ego.

        Raises:
            UnknownNameError: There is no such ego.
        """
        if name not in self.possible_agents:
            raise UnknownNameError("ego", str(name), self.possible_agents)
        return name

    def _simulated(self) -> Simulation:
        if not isinstance(self._running, Simulation):
            raise InvalidInputError(f"scenario '{self.scenario.name}' replays a log; SUMO does not simulate it")
        return self._running

    def close(self) -> None:
        """Ends SUMO."""
        self.agents = []
        if self._simulation is not None:
            self._simulation.close()

    def _new_sensors(self) -> dict[str, tuple[Sensor, ...]]:
        return {name: self._made_sensors(name, self._sensor_names[name]) for name in self._index}

    def _made_sensors(self, name: str, sensors: SensorNames) -> tuple[Sensor, ...]:
        noise = np.random.default_rng([SENSOR_NOISE, self.scenario.seed, self._index[name]])
        return make_sensors(sensors, Track.PRIVILEGED, conditions_named(self.scenario.conditions), noise)

    def _new_controls(self) -> dict[str, Control]:
        return {
            name: make_control(self._control_names[name], self._plan.vehicle, TICK_S) for name in self.possible_agents
        }

    def _observe(self, names: Sequence[str]) -> dict[str, Observation]:
        world = self.world
        return {
            name: {sensor.name: sensor.read(world, self._index[name]) for sensor in self._sensors[name]}
            for name in names
        }
