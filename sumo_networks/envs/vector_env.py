"""VectorDrivingEnv: many DrivingEnvs at once, one process each, which go through the episodes of a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.envs.env_rows import Observations, checked_actions, row_mask, row_seeds
from dohyo.sumo_networks.envs.options import DEFAULT_SENSORS, RENDERING, SensorNames
from dohyo.sumo_networks.envs.scenario_env import ScenarioSource, scenario_rows
from dohyo.sumo_networks.envs.worker_process import WorkerDeathError
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.seeds import checked_seed, episode_seed, training_seed

Step = tuple[Observations, FloatArray, BoolArray, BoolArray, dict[str, Any]]


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
            the last observation of the ended one in `infos["final_obs"][w]`, with its last infos in
            `infos["final_info"]`. NEXT_STEP: the step after the end ignores the action and returns the first
            observation of the next episode. DISABLED: the caller resets, with `options={"reset_mask": ...}`.

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
        self._rows = scenario_rows(scenarios, num_envs, sensors, control, reward, render_mode)
        self.closed = False
        self.num_envs, self.num_egos = num_envs, self._rows.group_size
        self.autoreset_mode, self.render_mode = autoreset_mode, render_mode
        self.metadata = {**RENDERING, "autoreset_mode": autoreset_mode}
        single: Callable[[gymnasium.Space[Any]], gymnasium.Space[Any]] = (
            (lambda space: space) if self.num_egos == 1 else (lambda space: batch_space(space, self.num_egos))
        )
        self.single_observation_space = single(self._rows.single_observation_space)
        self.single_action_space = single(self._rows.single_action_space)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seed, self._episode = 0, np.arange(num_envs) - num_envs
        self._begun, self._shown = False, self._episode  # that of the observations; -1 where a seed was given

    @property
    def pids(self) -> tuple[int, ...]:
        """Process ids of the workers; empty once closed."""
        return self._rows.pids

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Starts the next episode of every environment.

        Args:
            seed: Seed of a new run, which starts at episode 0. By default the run continues; the first run has seed 0.
                With one seed per environment, environment w drives scenario `seed[w]` with seed `seed[w]`, and the run
                stays where it is; None there: a random one.
            options: "reset_mask": (N,) bool, environments to reset; the observations of the others do not change.

        Returns:
            Observations, and infos as from `step`.

        Raises:
            InvalidInputError: A seed is negative or no whole number, that of one environment is above 2^31 - 1, seeds
                or mask have a wrong length (nothing has changed then), or a scenario is impossible.
            SimulationError: SUMO failed, a worker has died, or the environment is closed.
        """
        chosen = (options or {}).get("reset_mask")
        mask = np.ones(self.num_envs, np.bool_) if chosen is None else row_mask(chosen, self.num_envs)
        if isinstance(seed, Sequence | np.ndarray):
            seeds = [None if one is None else episode_seed(one) for one in row_seeds(seed, self.num_envs)]
            self._shown = np.where(mask, -1, self._shown)
            return self._reset(mask, seeds, {}), self._infos(self._rows.running.copy())
        if seed is not None:
            self._seed, self._episode = checked_seed(seed), np.arange(self.num_envs) - self.num_envs
        return self._begin_next(mask), self._infos(self._rows.running.copy())

    def step(self, actions: ArrayLike) -> Step:
        """Drives every ego of every environment for one tick of 0.1 s.

        Args:
            actions: (N, ...) or (N, E, ...) array in `action_space`.

        Returns:
            observations: Arrays by sensor, with the sensor's dtype, (N, ...) or (N, E, ...).
            rewards: (N,) or (N, E), float64.
            terminations: (N,) or (N, E), whether an ego's episode ended in this tick, at its goal or by its reward.
            truncations: (N,) or (N, E), whether an ego's episode ended at the time limit.
            infos: "active": whether the ego drove in this tick; "episode_number": (N,) number of the observations'
            episode, -1 if its seed was given; where episodes of egos ended also "success", (N,) or (N, E), whether the
            ego reached its goal, valid where "_success" is True; and, if an episode ended and the next began,
            "final_obs" and "final_info": its last observations and infos, valid where "_final_obs" and "_final_info"
            (N,) are True.

        Raises:
            InvalidActionError: The actions have a wrong shape or are not finite; the simulations are then unchanged.
            SimulationError: SUMO failed, a worker has died, or the environment is closed.
        """
        if not (self._begun or self.closed):
            raise SimulationError("this VectorDrivingEnv has not been reset")
        idle = self._ended()
        observations, rewards, terminations, truncations, infos = self._rows.step(self._by_row(actions))
        self._check_failures()
        seen, active, result = self._by_env(observations), infos["active"], self._success(infos)
        ended = self._ended()
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and any(idle):
            mask = np.array(idle)
            seen = self._begin_next(mask)
        elif self.autoreset_mode is AutoresetMode.SAME_STEP and any(ended):
            mask = np.array(ended)
            last = {"final_obs": _of_some(seen, mask), "final_info": {**self._infos(active), **result}}
            seen, result = self._begin_next(mask), {**result, **last, "_final_obs": mask, "_final_info": mask}
        ends = self._squeezed(terminations), self._squeezed(truncations)
        return seen, self._squeezed(rewards), *ends, {**self._infos(active), **result}

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One (480, 480, 3) RGB picture from above per environment; None without a render mode.

        Raises:
            SimulationError: An environment has not been reset, a worker has died, or the environment is closed.
        """
        return None if self.render_mode is None else self._rows.render()

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the processes; `close` calls it once."""
        self._rows.close()

    def _begin_next(self, mask: BoolArray) -> Observations:
        """Begins the run's next episodes in some environments."""
        self._episode[mask] += self.num_envs
        self._shown = np.where(mask, self._episode, self._shown)
        begun = zip(self._episode.tolist(), mask.tolist(), strict=True)
        seeds = [training_seed(self._seed, episode) if now else None for episode, now in begun]
        return self._reset(mask, seeds, {"episodes": self._episode})

    def _reset(self, mask: BoolArray, seeds: Sequence[int | None], options: dict[str, Any]) -> Observations:
        """Begins episodes with seeds, one per environment."""
        self._begun, rows = True, np.repeat(mask, self.num_egos)
        repeated = [seed for seed in seeds for _ in range(self.num_egos)]
        observations, _ = self._rows.reset(seed=repeated, options={**options, "reset_mask": rows})
        self._check_failures()
        return self._by_env(observations)

    def _check_failures(self) -> None:
        """Raises the error of the first simulation that failed; closes this environment if its worker has died."""
        for error in self._rows.failures.values():
            if isinstance(error, WorkerDeathError):
                self.close()
                raise SimulationError(f"{error}; this VectorDrivingEnv is closed") from error
            raise error

    def _ended(self) -> list[bool]:
        """Whether the episodes of all egos have ended, for each environment."""
        if self._rows.all_running:
            return [False] * self.num_envs
        running = self._rows.running.reshape(self.num_envs, self.num_egos)
        return [not any(egos) for egos in running.tolist()]

    def _infos(self, active: BoolArray) -> dict[str, Any]:
        return {"active": self._squeezed(active), "episode_number": self._shown.copy()}

    def _success(self, infos: dict[str, Any]) -> dict[str, Any]:
        """Success of the egos whose episodes ended in this tick, in the form of infos."""
        if "success" not in infos:
            return {}
        ended = infos["_success"]
        return {"success": self._squeezed(infos["success"] & ended), "_success": self._squeezed(ended)}

    def _by_row(self, actions: ArrayLike) -> ArrayLike:
        """Actions of all egos, one after the other."""
        if self.num_egos == 1:
            return actions
        checked = checked_actions(actions, self.action_space.shape or (), np.float32)
        return checked.reshape(self._rows.action_space.shape or ())

    def _by_env(self, observations: Observations) -> Observations:
        return observations if self.num_egos == 1 else {name: self._squeezed(a) for name, a in observations.items()}

    def _squeezed(self, array: NDArray[Any]) -> NDArray[Any]:
        """Array of rows as (N, E, ...), without the axis of egos if there is one ego."""
        return array if self.num_egos == 1 else array.reshape(self.num_envs, self.num_egos, *array.shape[1:])


def _of_some(observations: Observations, mask: BoolArray) -> NDArray[np.object_]:
    """(N,) observations by sensor of some environments; None for the others."""
    some = np.full(len(mask), None, dtype=object)
    for env in np.flatnonzero(mask).tolist():
        some[env] = {name: array[env] for name, array in observations.items()}
    return some
