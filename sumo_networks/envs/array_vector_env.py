"""ArrayVectorEnv: worlds in one process whose episodes advance together, as rows of arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.envs.env_rows import Observations, checked_actions, named_space, row_mask, row_seeds
from dohyo.sumo_networks.envs.row_vector_env import Step
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError


class ArrayVectorEnv(VectorEnv[Observations, Any, NDArray[Any]], ABC):
    """N episodes of at most a fixed length, at whose end they are truncated.

    Each row has its own time, and draws everything random at its reset, from a generator of its own seed. So an
    episode follows from its seed and its actions, whatever the other rows do. A row whose episode has ended ignores
    its action and keeps its observation until it is reset, and its reward is 0.

    Attributes:
        num_envs: Number N of rows.
        length: Steps of an episode.
        measures: Names of the floats in `infos` at the end of an episode.
        group_size: Rows of one simulation, which are reset together, with the seed of the first one.
        running: (N,) whether the row's episode has begun and not ended.
        metadata: "autoreset_mode" is DISABLED: the caller resets.
    """

    def __init__(
        self,
        num_envs: int,
        observation_space: Box,
        action_space: Box,
        length: int,
        measures: tuple[str, ...] = (),
        group_size: int = 1,
    ) -> None:
        """Prepares; episodes begin with their reset.

        Args:
            num_envs: Number of rows.
            observation_space: Of one row, named "observation".
            action_space: Of one row, a vector of float32.
            length: Steps of an episode.
            measures: See the class.
            group_size: See the class.

        Raises:
            InvalidInputError: There is no row, or the rows are no whole number of groups.
        """
        if num_envs < 1 or num_envs % group_size:
            raise InvalidInputError(
                f"expected at least one row and whole groups of {group_size}, got num_envs={num_envs}"
            )
        self.num_envs, self.length, self.measures, self.group_size = num_envs, length, measures, group_size
        self.metadata = {"autoreset_mode": AutoresetMode.DISABLED}
        self.single_observation_space = named_space(observation_space)
        self.single_action_space = action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(action_space, num_envs)
        self._name = next(iter(self.single_observation_space))
        self._observation = np.zeros((num_envs, *observation_space.shape), np.float32)
        self._steps = np.zeros(num_envs, np.int64)
        self.running: BoolArray = np.zeros(num_envs, np.bool_)

    def _begin_seeded(self, rows: IntArray, seeds: Sequence[int | None], options: Mapping[str, Any]) -> None:
        """Begins episodes in R rows from one seed each (None: any), with the other options of `reset`."""
        self._begin(rows, [np.random.default_rng(seed) for seed in seeds])

    @abstractmethod
    def _begin(self, rows: IntArray, generators: Sequence[np.random.Generator]) -> None:
        """Begins episodes in R rows, one generator each."""

    @abstractmethod
    def _advance(self, rows: IntArray, actions: FloatArray) -> FloatArray:
        """Takes a step in R rows: (R, A) float64 actions -> (R,) rewards."""

    @abstractmethod
    def _observed(self, rows: IntArray) -> FloatArray:
        """(R, O) observations of R rows, after `_begin` or `_advance`; `_steps` counts the steps so far."""

    def _terminated(self, rows: IntArray) -> BoolArray:
        """(R,) whether the episodes of R rows have terminated in the step just taken."""
        return np.zeros(len(rows), np.bool_)

    @abstractmethod
    def _measured(self, rows: IntArray) -> Mapping[str, FloatArray]:
        """(R,) of each measure, of R rows whose episodes have just ended."""

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Observations, dict[str, Any]]:
        """Begins episodes.

        Args:
            seed: One seed or None per row; or s for s, s + 1, ...
            options: "reset_mask": (N,) bool, the rows to reset, with all rows of their groups; the others keep their
                episodes and observations.

        Returns:
            Observations of all rows, and no infos.

        Raises:
            InvalidInputError: Seeds or mask have a wrong length.
        """
        self._check_open()
        rest = dict(options or {})
        mask = row_mask(rest.pop("reset_mask", np.ones(self.num_envs, np.bool_)), self.num_envs)
        groups = np.repeat(mask.reshape(-1, self.group_size).any(axis=1), self.group_size)
        seeds, rows = row_seeds(seed, self.num_envs), np.flatnonzero(groups)
        self._steps[rows], self.running[rows] = 0, True
        if len(rows):
            self._begin_seeded(rows, [seeds[row] for row in rows.tolist()], rest)
            self._observation[rows] = self._observed(rows)
        return self._observations(), {}

    def step(self, actions: ArrayLike) -> Step:
        """Takes one step in every row whose episode has not ended.

        Args:
            actions: (N, A) in `action_space`.

        Returns:
            observations: (N, O) by name; at an end the last one of the episode.
            rewards: (N,) float64.
            terminations: (N,) whether the episode has terminated.
            truncations: (N,) whether it has ended otherwise, at its length.
            infos: "active" (N,): whether the row acted; where episodes ended also the measures.

        Raises:
            InvalidActionError: The actions have a wrong shape or are not finite; nothing has moved then.
        """
        self._check_open()
        checked = checked_actions(actions, self.action_space.shape or (), np.float64)
        active, rewards = self.running.copy(), np.zeros(self.num_envs)
        terminated = np.zeros(self.num_envs, np.bool_)
        rows = np.flatnonzero(active)
        if len(rows):
            rewards[rows] = self._advance(rows, checked[rows])
            self._steps[rows] += 1
            self._observation[rows] = self._observed(rows)
            terminated[rows] = self._terminated(rows)
        truncated = active & ~terminated & (self._steps == self.length)
        ended = terminated | truncated
        self.running &= ~ended
        infos: dict[str, Any] = {"active": active}
        if ended.any():
            infos |= self._judgement(ended)
        return self._observations(), rewards, terminated, truncated, infos

    def _judgement(self, ended: BoolArray) -> dict[str, Any]:
        judged: dict[str, Any] = {}
        for name, values in self._measured(np.flatnonzero(ended)).items():
            judged[name], judged[f"_{name}"] = np.zeros(self.num_envs), ended
            judged[name][ended] = values
        return judged

    def _observations(self) -> Observations:
        return {self._name: self._observation.copy()}

    def _check_open(self) -> None:
        if self.closed:
            raise SimulationError(f"this {type(self).__name__} is closed")
