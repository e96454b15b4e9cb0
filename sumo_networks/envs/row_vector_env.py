"""RowVectorEnv: what vector environments in this process and in worker processes share."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import AlreadyPendingCallError, NoAsyncCallError
from gymnasium.spaces import Box, Discrete
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from dohyo.sumo_networks.arrays import BoolArray, FloatArray
from dohyo.sumo_networks.envs.env_rows import (
    EnvError,
    Observations,
    RowArrays,
    RowPlan,
    checked_actions,
    named_space,
    row_mask,
    row_seeds,
)
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError

logger = logging.getLogger(__name__)

Step = tuple[Observations, FloatArray, BoolArray, BoolArray, dict[str, Any]]


class RowVectorEnv(VectorEnv[Observations, Any, NDArray[Any]], ABC):
    """N rows, each an agent of an episode; a row is reset alone, to a given seed.

    An environment may have several agents (a ParallelEnv of PettingZoo): these are consecutive rows, which are reset
    together. A row whose episode has ended ignores its action until it is reset, and its reward is 0.

    Rows may begin an episode while the others drive, see `reset`: their environments start at the same time, in their
    processes. Until they begin, their observations are 0. When they begin depends on numbers of steps, never on time.

    Where an environment raises SimulationError or its process dies, its rows are truncated without measures and
    reported as "lost". A new environment replaces it at the next reset. Any other error ends the step or reset.

    Attributes:
        num_envs: Number N of rows.
        group_size: Number of agents, and so of rows, of one environment.
        single_observation_space: Dict of Box.
        single_action_space: Box or Discrete.
        measures: Names of the floats in `infos` at the end of an episode, beside "success".
        running: (N,) whether the row's episode has begun and not ended.
        all_running: Whether all have.
        failures: Errors of the environments that were lost in the last reset or step, by environment.
        metadata: "autoreset_mode" is DISABLED: the caller resets.

    Source: gymnasium's VectorEnv interface.
    """

    def __init__(
        self,
        make_env: Callable[[int], Any],
        num_envs: int,
        observation_space: gymnasium.Space[Any],
        action_space: gymnasium.Space[Any],
        measures: tuple[str, ...] = (),
        expert: bool = False,
        group_size: int = 1,
    ) -> None:
        """Checks the spaces; environments are made at their first reset.

        Args:
            make_env: Makes the environment of a rank (0, 1, ...).
            num_envs: Number of rows, a multiple of `group_size`.
            observation_space: Of one row: Dict of Box of float32 or uint8; a Box becomes {"observation": box}.
            action_space: Of one row: Box or Discrete.
            measures: Names of floats that the last info of an episode must hold.
            expert: Whether the environments have a method `expert_action() -> action | None`; with several agents it
                takes the agent's name.
            group_size: Number of agents of one environment.

        Raises:
            InvalidInputError: A space is of another kind, or there is no environment.
        """
        self.closed = True  # until the environments can be used
        if num_envs < 1 or num_envs % group_size:
            raise InvalidInputError(f"expected at least one environment of {group_size} rows, got num_envs={num_envs}")
        if not isinstance(action_space, Box | Discrete):
            raise InvalidInputError(f"expected actions in a Box or Discrete, got {action_space}")
        self.num_envs, self.group_size, self.measures = num_envs, group_size, measures
        self.metadata = {"autoreset_mode": AutoresetMode.DISABLED}
        self.single_observation_space: gymnasium.spaces.Dict = named_space(observation_space)
        self.single_action_space = action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(action_space, num_envs)
        self.failures: dict[int, SimulationError] = {}
        self._plan = RowPlan(
            make_env, num_envs // group_size, group_size, self.single_observation_space, action_space, measures
        )
        self._has_expert = expert
        self._arrays = self._take_arrays()
        self._set_running(np.zeros(num_envs, np.bool_))
        self._pending: list[int] | None = None
        self._starting: dict[int, int] = {}  # environments whose reset goes on: steps until their rows begin
        self._heard: dict[int, Any] = {}  # answers that came before they were due
        self.closed = False

    @abstractmethod
    def _take_arrays(self) -> RowArrays:
        """Arrays of all rows; called once, by the constructor."""

    @abstractmethod
    def _send(self, group: int, command: str, *arguments: Any) -> None:
        """Begins a method of an environment's `EnvRows`; failures show in `_receive`."""

    @abstractmethod
    def _receive(self, group: int) -> Any:
        """Waits for the end of the method; returns its result, or raises what it raised."""

    @abstractmethod
    def _discard(self, group: int) -> None:
        """Ends an environment that failed; its next reset makes a new one."""

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Observations, dict[str, Any]]:
        """Begins episodes.

        Args:
            seed: One seed or None per row, of which a group takes its first; or s for s, s + 1, ...
            options: "reset_mask": (N,) bool, the rows to reset; the others keep their episodes and observations.
                "begin_after": number of steps after which the rows begin; until then the others go on, and where none
                does, they begin at once. All other options go to the environments.

        Returns:
            Observations of all rows, and infos: "lost" (N,) is True where the reset failed; "begun" (N,) where it is
            done. With "begin_after", a later step tells both.

        Raises:
            InvalidInputError: Seeds or mask have a wrong length.
            DohyoError: An environment's own error; EnvError if its code failed.
        """
        self._check_idle()
        rest = dict(options or {})
        after = int(rest.pop("begin_after", 0))
        asked = self._groups(row_mask(rest.pop("reset_mask", np.ones(self.num_envs, np.bool_)), self.num_envs))
        seeds, chosen = row_seeds(seed, self.num_envs), self._rows(asked)
        self._collect([group for group in asked if self._starting.pop(group, None) is not None])
        self._set_running(self.running & ~chosen)
        for group in asked:
            self._send(group, "reset", seeds[group * self.group_size], rest or None)
            self._starting[group] = after
        begun, lost = self._begin()
        return self._observations(), {"lost": lost, "begun": begun}

    def step(self, actions: ArrayLike) -> Step:
        """Takes one step in every row whose episode has not ended.

        Args:
            actions: (N, ...) in `action_space`.

        Returns:
            Observations (N, ...) by name, at an end the last ones of the episode; rewards (N,) float64; terminations
            (N,); truncations (N,), also True where the environment was lost; and infos: "active" (N,), whether the row
            acted; "lost" (N,), whether its environment failed; where episodes ended also "success" and the measures,
            each (N,) and valid where "_success" and so on are True; and where resets go on "begun" (N,), whether the
            row's episode has begun with these observations. A reset that failed is "lost" in a row that did not act.

        Raises:
            InvalidActionError: The actions have a wrong shape or are not finite; nothing has moved then.
            DohyoError: An environment's own error; EnvError if its code failed.
        """
        self.step_async(actions)
        return self.step_wait()

    def step_async(self, actions: ArrayLike) -> None:
        """Begins a step, see `step`; `step_wait` must follow.

        Raises:
            InvalidActionError: The actions have a wrong shape or are not finite.
        """
        self._check_idle()
        shared = self._arrays.actions
        shared[...] = checked_actions(actions, shared.shape, shared.dtype)
        if not self.all_running:
            self._clear()
        for group in self._running_groups:
            self._send(group, "step")
        self._pending = self._running_groups

    def step_wait(self) -> Step:
        """Waits for the step that `step_async` began, see `step`."""
        if self._pending is None:
            raise NoAsyncCallError("expected step_async() before step_wait()", "step")
        asked, self._pending = self._pending, None
        arrays, active = self._arrays, self.running
        lost = self._finish(asked)
        if self.failures:
            lost &= active
            arrays.rewards[lost], arrays.terminations[lost], arrays.truncations[lost] = 0.0, False, True
        infos: dict[str, Any] = {"active": active.copy(), "lost": lost}
        terminations, truncations = arrays.terminations.copy(), arrays.truncations.copy()
        ended = terminations | truncations
        if ended.any():
            self._set_running(active & ~ended)
            infos |= self._judgement(ended & ~lost)
        if self._starting:
            infos["begun"], failed = self._begin(steps=1)
            infos["lost"] = lost | failed
        return self._observations(), arrays.rewards.copy(), terminations, truncations, infos

    def expert_actions(self, rows: BoolArray) -> tuple[NDArray[Any], BoolArray]:
        """Asks the expert for its actions for the present observations.

        Args:
            rows: (N,) rows to ask for.

        Returns:
            (N, ...) actions, and (N,) whether the expert has one: never where an episode has ended or is being lost.

        Raises:
            InvalidInputError: The environments have no expert.
            DohyoError: An environment's own error; EnvError if its code failed.
        """
        if not self._has_expert:
            raise InvalidInputError("these environments have no expert")
        self._check_idle()
        wanted = row_mask(rows, self.num_envs) & self.running
        asked = self._groups(wanted)
        for group in asked:
            self._send(group, "ask_expert")
        failed = self._finish(asked, keep=True)  # the next step reports the loss
        return self._arrays.expert_actions.copy(), self._arrays.expert_known & wanted & ~failed

    def render(self) -> tuple[Any, ...] | None:
        """Pictures of all environments.

        Raises:
            SimulationError: An environment has not been reset, or its process has died.
        """
        self._check_idle()
        self._heard |= self._collect(self._starting)
        groups = range(self._plan.groups)
        for group in groups:
            self._send(group, "render")
        pictures = self._collect(groups)
        for picture in pictures.values():
            if isinstance(picture, Exception):
                raise picture
        return tuple(pictures.values())

    def _begin(self, steps: int = 0) -> tuple[BoolArray, BoolArray]:
        """Begins the episodes whose time has come after some more steps; (N,) rows that begin, and that are lost."""
        self._starting = {group: left - steps for group, left in self._starting.items()}
        due = [group for group, left in self._starting.items() if left <= 0 or not self.running.any()]
        for group in due:
            del self._starting[group]
        earlier = self.failures if steps else {}
        lost = self._finish(due)
        self.failures |= earlier
        begun = self._rows(due) & ~lost
        self._set_running(self.running | begun)
        return begun, lost & self._rows(due)

    def _set_running(self, running: BoolArray) -> None:
        self.running, self.all_running = running, bool(running.all())
        self._running_groups = self._groups(running)

    def _check_idle(self) -> None:
        if self.closed:
            raise SimulationError(f"this {type(self).__name__} is closed")
        if self._pending is not None:
            raise AlreadyPendingCallError("expected step_wait() after step_async()", "step")

    def _finish(self, asked: Iterable[int], keep: bool = False) -> BoolArray:
        """Waits for environments; (N,) rows of those that failed, which are discarded unless they are to be kept."""
        answers = self._collect(asked)
        errors = {group: answer for group, answer in answers.items() if isinstance(answer, Exception)}
        self.failures = {group: error for group, error in errors.items() if isinstance(error, SimulationError)}
        for group, error in self.failures.items():
            logger.warning("environment %d is lost: %s", group, error)
            if not keep:
                self._discard(group)
        for group, cause in errors.items():
            if isinstance(cause, EnvError):
                logger.error("environment %d failed", group, exc_info=cause)
            if not isinstance(cause, SimulationError):
                raise cause
        return self._rows(self.failures)

    def _collect(self, asked: Iterable[int]) -> dict[int, Any]:
        """Results or errors of all environments that were asked."""
        answers: dict[int, Any] = {}
        try:
            for group in asked:
                try:
                    answers[group] = self._heard.pop(group) if group in self._heard else self._receive(group)
                except Exception as error:
                    answers[group] = error
        except BaseException:  # such as Ctrl-C: pending answers would be taken for answers to the next command
            self.close()
            raise
        return answers

    def _clear(self) -> None:
        """Empties the results of rows that have ended, which nobody writes."""
        arrays = self._arrays
        arrays.rewards[:] = 0.0
        arrays.terminations[:] = arrays.truncations[:] = False
        if self.group_size > 1:
            for observation in arrays.observations.values():
                observation[~self.running & ~self._rows(self._starting)] = 0

    def _judgement(self, ended: BoolArray) -> dict[str, NDArray[Any]]:
        """Success and measures of the episodes that ended, in the form of infos."""
        if not ended.any():
            return {}
        columns = dict(zip(self.measures, self._arrays.measures.T, strict=True))
        values = {"success": self._arrays.successes, **columns}
        return {name: value.copy() for name, value in values.items()} | {f"_{name}": ended for name in values}

    def _observations(self) -> Observations:
        observations = {name: array.copy() for name, array in self._arrays.observations.items()}
        if self._starting:  # their processes may be writing
            starting = self._rows(self._starting)
            for observation in observations.values():
                observation[starting] = 0
        return observations

    def _groups(self, rows: BoolArray) -> list[int]:
        """Environments of which a row is in a mask."""
        return [group for group, some in enumerate(rows.reshape(-1, self.group_size).tolist()) if any(some)]

    def _rows(self, groups: Iterable[int]) -> BoolArray:
        """(N,) mask of the rows of environments."""
        rows = np.zeros(self.num_envs, np.bool_)
        for group in groups:
            rows[group * self.group_size : (group + 1) * self.group_size] = True
        return rows
