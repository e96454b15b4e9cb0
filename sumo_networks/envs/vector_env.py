"""VectorDrivingEnv: many DrivingEnvs at once, one process each, since libsumo is global to its process.

Parent and workers share the memory of observations, rewards, ends and actions; a step is one empty message to each
worker and one back, and nothing is pickled. The memory has no name in the file system, and a worker ends when its pipe
closes, so nothing remains however the parent ends.
"""

from __future__ import annotations

import multiprocessing
import weakref
from collections.abc import Callable, Iterable, Mapping
from multiprocessing.context import SpawnProcess
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray
from dohyo.sumo_networks.ego.control import InvalidActionError, make_control
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.envs.driving_env import DEFAULT_SENSORS, RENDERING, SensorNames, check_render_mode
from dohyo.sumo_networks.envs.reward import make_reward
from dohyo.sumo_networks.envs.vector_memory import Observations, SharedMemory, WorkerPipe
from dohyo.sumo_networks.envs.vector_worker import RENDER, RESET, STEP, Plan, ScenarioSource, unpacked, work
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.units import TICK_S

Step = tuple[Observations, FloatArray, BoolArray, BoolArray, dict[str, Any]]

JOIN_S = 5.0


class VectorDrivingEnv(VectorEnv[Observations, Any, NDArray[Any]]):
    """N environments that step together.

    Environment w drives the episodes w, w + N, w + 2N... of the run. Episode k has scenario k (of a list that repeats)
    and seed `training_seed(seed, k)`. The episodes do not depend on N, only which environment drives them.

    With one ego per scenario, arrays start with (N,); with E > 1 egos with (N, E), in the order of the missions. An
    environment's episode ends with its last ego. Until then, an ego whose own episode has ended is masked: its action
    is ignored, its rewards and observations are 0, and `infos["active"]` is False.

    Attributes:
        num_envs: Number N of environments.
        num_egos: Number E of egos per environment.
        single_observation_space: One Box per sensor; (E, ...) where E > 1.
        single_action_space: Space of the control interface; (E, ...) where E > 1.
        autoreset_mode: SAME_STEP: the step that ends an episode returns the first observation of the next episode, and
            the last observation of the ended one in `infos["final_obs"][w]`. NEXT_STEP: the step after the end ignores
            the action and returns the first observation of the next episode. DISABLED: the caller resets, with
            `options={"reset_mask": ...}`.

    Source: gymnasium's VectorEnv interface.
    """

    def __init__(
        self,
        scenarios: ScenarioSource,
        num_envs: int,
        sensors: SensorNames = DEFAULT_SENSORS,
        control: str = "target_speed_steering",
        reward: str | None = "roach",
        autoreset_mode: AutoresetMode = AutoresetMode.SAME_STEP,
        render_mode: str | None = None,
    ) -> None:
        """Checks every name and starts the processes; SUMO starts at `reset`.

        Args:
            scenarios: One or more scenarios with the same number of egos; or a function from an episode's number to its
                scenario, which the workers import and call.
            num_envs: Number of environments, one process each.
            sensors: Names from `sensors.SENSORS` or sensor configurations, for all egos.
            control: Name from `control.CONTROLS`, for all egos.
            reward: Name from `reward.REWARDS`; None: rewards are 0 and only the goal terminates.
            autoreset_mode: Mode of automatic resets, see the class.
            render_mode: "rgb_array" for pictures from `render`.

        Raises:
            InvalidInputError: A name is unknown, no scenario is given, or scenarios differ in the number of egos.
        """
        self.closed = True  # until the processes start
        if num_envs < 1:
            raise InvalidInputError(f"expected at least one environment, got num_envs={num_envs}")
        if reward is not None:
            make_reward(reward)
        check_render_mode(render_mode)
        self.num_envs, self.num_egos = num_envs, _count_egos(scenarios)
        self.autoreset_mode = autoreset_mode
        self.render_mode = render_mode
        self.metadata = {**RENDERING, "autoreset_mode": autoreset_mode}
        self._set_spaces(sensors, control)
        context = multiprocessing.get_context("spawn")
        memory = SharedMemory(
            context, num_envs, self.num_egos, self._sensor_boxes, self._action.shape, renders=render_mode is not None
        )
        self._arrays = memory.arrays()
        plan = Plan(scenarios, tuple(sensors), control, reward, render_mode, num_envs, autoreset_mode)
        self._channels: list[WorkerPipe] = []
        self._processes: list[SpawnProcess] = []
        self._finalizer = weakref.finalize(self, _shut_down, self._channels, self._processes)
        self.closed = False
        for worker in range(num_envs):
            ours, theirs = context.Pipe()
            process = context.Process(target=work, args=(theirs, memory, plan, worker), daemon=True)
            process.start()
            theirs.close()
            self._channels.append(WorkerPipe(ours))
            self._processes.append(process)
        self._seeded = False

    def _set_spaces(self, sensors: SensorNames, control: str) -> None:
        self._action = make_control(control, VehicleParameters(), TICK_S).space
        boxes = {sensor.name: sensor.space for sensor in make_sensors(sensors)}
        single: Callable[[gymnasium.Space[Any]], gymnasium.Space[Any]] = (
            (lambda space: space) if self.num_egos == 1 else (lambda space: batch_space(space, self.num_egos))
        )
        self.single_observation_space = gymnasium.spaces.Dict({name: single(box) for name, box in boxes.items()})
        self.single_action_space = single(self._action)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._sensor_boxes = boxes

    @property
    def pids(self) -> tuple[int, ...]:
        """Process ids of the workers; empty once closed."""
        return tuple(process.pid for process in self._processes if process.pid is not None)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Starts the next episode of every environment.

        Args:
            seed: Seed of a new run, which starts at episode 0. By default the run continues; the first run has seed 0.
            options: "reset_mask": (N,) bool, environments to reset; the observations of the others do not change.

        Returns:
            Observations, and infos as from `step`.

        Raises:
            InvalidInputError: A scenario is impossible.
            SimulationError: SUMO failed, a worker has died, or the environment is closed.
        """
        mask = np.ones(self.num_envs, np.bool_)
        if options and options.get("reset_mask") is not None:
            mask = np.asarray(options["reset_mask"], dtype=np.bool_).reshape(self.num_envs)
        arrays = self._arrays
        if seed is not None or not self._seeded:
            arrays.seed[0], self._seeded = seed or 0, True
            arrays.episode[:] = np.arange(self.num_envs) - self.num_envs
        arrays.episode[mask] += self.num_envs
        self._ask(RESET, np.flatnonzero(mask).tolist())
        return self._observations(arrays.observations), self._infos()

    def step(self, actions: Any) -> Step:
        """Drives every ego of every environment for one tick of 0.1 s.

        Args:
            actions: (N, ...) or (N, E, ...) array in `action_space`.

        Returns:
            observations: Arrays by sensor, with the sensor's dtype, (N, ...) or (N, E, ...).
            rewards: (N,) or (N, E), float64.
            terminations: (N,) or (N, E), whether an ego's episode ended in this tick, at its goal or by its reward.
            truncations: (N,) or (N, E), whether an ego's episode ended at the time limit.
            infos: "active": whether the ego drove in this tick; "episode": (N,) number of the observations' episode;
            and, if an episode ended and the next began, "final_obs", in the form of the observations but valid only
            where "_final_obs" (N,) is True.

        Raises:
            InvalidActionError: The actions have a wrong shape or are not finite; the simulations are then unchanged.
            SimulationError: SUMO failed, a worker has died, or the environment is closed.
        """
        arrays = self._arrays
        arrays.actions[...] = self._checked(actions)
        self._ask(STEP, range(self.num_envs))
        infos = self._infos()
        if arrays.renewed.any():
            infos["final_obs"] = self._final_observations()
            infos["_final_obs"] = arrays.renewed.copy()
        return (
            self._observations(arrays.observations),
            self._squeezed(arrays.rewards),
            self._squeezed(arrays.terminations),
            self._squeezed(arrays.truncations),
            infos,
        )

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One (480, 480, 3) RGB picture from above per environment; None without a render mode.

        Raises:
            SimulationError: An environment has not been reset, a worker has died, or the environment is closed.
        """
        if self.render_mode is None:
            return None
        self._ask(RENDER, range(self.num_envs))
        return tuple(self._arrays.frames.copy())

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the processes; `close` calls it once."""
        self._finalizer()

    def _checked(self, actions: Any) -> Float32Array:
        shape = (self.num_envs, self.num_egos, *self._action.shape)
        expected = self.action_space.shape
        try:
            array = np.asarray(actions, dtype=np.float32)
        except (TypeError, ValueError) as error:
            raise InvalidActionError(f"expected an array of shape {expected}, got {actions!r}"[:200]) from error
        if array.shape != expected:
            raise InvalidActionError(f"expected actions of shape {expected}, got shape {array.shape}")
        if not np.isfinite(array).all():
            raise InvalidActionError(f"expected finite actions, got {array[~np.isfinite(array)][:4].tolist()}")
        return array.reshape(shape)

    def _ask(self, command: bytes, workers: Iterable[int]) -> None:
        """Sends a command to workers and waits for all answers; raises the first error."""
        if self.closed:
            raise SimulationError("this VectorDrivingEnv is closed")
        asked, errors, worker = list(workers), [], -1
        try:
            for worker in asked:
                self._channels[worker].send(command)
            for worker in asked:
                answer = self._channels[worker].receive()
                if answer:
                    errors.append(unpacked(answer, worker))
        except (EOFError, OSError) as error:
            process = self._processes[worker]
            process.join(JOIN_S)
            death = f"worker {worker} (process {process.pid}) ended with code {process.exitcode}"
            self.close()
            raise SimulationError(f"{death}; this VectorDrivingEnv is closed") from error
        except BaseException:  # such as Ctrl-C: pending answers would be taken for answers to the next command
            self.close()
            raise
        if errors:
            raise errors[0]

    def _infos(self) -> dict[str, Any]:
        return {"active": self._squeezed(self._arrays.active), "episode": self._arrays.episode.copy()}

    def _observations(self, arrays: Mapping[str, Float32Array]) -> Observations:
        return {name: self._squeezed(array) for name, array in arrays.items()}

    def _final_observations(self) -> NDArray[np.object_]:
        """(N,) last observation of each ended episode, by sensor; None for the others."""
        finals = np.full(self.num_envs, None, dtype=object)
        observations = self._observations(self._arrays.finals)
        for worker in np.flatnonzero(self._arrays.renewed).tolist():
            finals[worker] = {name: array[worker] for name, array in observations.items()}
        return finals

    def _squeezed(self, array: NDArray[Any]) -> NDArray[Any]:
        """Copies an array, without the axis of egos if there is one ego."""
        return array[:, 0].copy() if self.num_egos == 1 else array.copy()


def _count_egos(scenarios: ScenarioSource) -> int:
    if callable(scenarios):
        return len(scenarios(0).missions)
    counts = sorted({len(scenario.missions) for scenario in scenarios})
    if len(counts) != 1:
        raise InvalidInputError(f"expected scenarios with the same number of egos, got {counts or 'no scenario'}")
    return counts[0]


def _shut_down(channels: list[WorkerPipe], processes: list[SpawnProcess]) -> None:
    """Ends all workers: closes their pipes, and kills workers that do not end."""
    for channel in channels:
        channel.close()
    for process in processes:
        process.join(JOIN_S)
        if process.is_alive():
            process.kill()
            process.join()
        process.close()
    channels.clear()
    processes.clear()
