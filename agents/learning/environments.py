"""Environments: the training episodes of a run, which can be restored exactly."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import torch

from dohyo.agents.learning.task import Array, Task
from dohyo.agents.learning.worker import Seat, View
from dohyo.sumo_networks.arrays import BoolArray, Float32Array
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.seeds import training_seed

logger = logging.getLogger(__name__)

MAX_LOST = 5
"""Number of consecutive lost episodes that ends a run."""
_GUIDED = 1  # separates this random stream from that of the seeds


@dataclass(slots=True)
class Episode:
    """An episode that is being driven.

    Attributes:
        number: Index over all environments of the run.
        seed: Of its reset.
        guided: Whether the expert drives it.
        total: Rewards so far.
        actions: Since its reset, in the action space.
    """

    number: int
    seed: int
    guided: bool
    total: float = 0.0
    actions: list[Array] = field(default_factory=list)


class Finished(NamedTuple):
    """An episode that has ended.

    Attributes:
        guided: Whether the expert drove it.
        total: Sum of its rewards.
        length: Its steps.
        success: Whether it succeeded.
        measures: The task's measures.
    """

    guided: bool
    total: float
    length: int
    success: bool
    measures: Mapping[str, float]


class Transition(NamedTuple):
    """One step of all N environments.

    Attributes:
        observation: (N, ...) after the step; a new episode's first one is in `Environments.observation`.
        reward: (N,).
        terminated: (N,).
        truncated: (N,).
        finished: The episodes that ended in this step.
    """

    observation: Array
    reward: Float32Array
    terminated: BoolArray
    truncated: BoolArray
    finished: list[Finished]


class Environments:
    """N environments that step together. One whose episode ends begins the run's next episode.

    SUMO's state cannot be saved exactly, but it follows from the episode's seed and actions: those are kept, and
    replayed to go on.

    Attributes:
        guided_share: Probability that the expert drives a new episode.
        observation: (N, ...) to act on now.
        expert: The expert's action, or None, for each environment.
        steps: Taken so far, of all environments together.
        finished_count: Episodes that have ended.
        lost_count: Episodes whose simulation failed.
    """

    def __init__(self, task: Task, seats: Sequence[Seat], seed: int) -> None:
        """Prepares; episodes start in `begin` or `restore`.

        Args:
            task: Of the workers.
            seats: One per environment.
            seed: Of the run.
        """
        self._task, self._seats, self._seed = task, seats, seed
        self._episodes: list[Episode] = []
        self._next, self.steps, self.finished_count, self.lost_count = 0, 0, 0, 0
        self._lost_in_a_row, self.guided_share = 0, 0.0
        self.observation: Array = np.zeros((len(seats), *task.observation_space.shape), task.observation_space.dtype)
        self.expert: list[Array | None] = [None] * len(seats)

    def __len__(self) -> int:
        return len(self._seats)

    def begin(self) -> None:
        """Begins the first episodes."""
        self._episodes = [self._next_episode() for _ in self._seats]
        self._reset(range(len(self)))

    def step(self, actions: Array) -> Transition:
        """Takes one step in all environments.

        Args:
            actions: (N, ...) in the action space.

        Raises:
            TaskError: The task's code failed.
            SimulationError: Simulations fail again and again; if one does, its episode is cut off and the next begins.
        """
        views = self._driven(actions)
        finished: list[Finished] = []
        for rank, view in enumerate(views):
            self._episodes[rank].total += view.reward
            self._look(rank, view)
        transition = Transition(
            self.observation.copy(),
            np.array([view.reward for view in views], np.float32),
            np.array([view.terminated for view in views]),
            np.array([view.truncated for view in views]),
            finished,
        )
        ended = [rank for rank, view in enumerate(views) if view.ended]
        for rank in ended:
            old, measures = self._episodes[rank], views[rank].measures
            if measures is not None:
                finished.append(Finished(old.guided, old.total, len(old.actions), views[rank].success, measures))
            self._episodes[rank] = self._next_episode()
        self._reset(ended)
        self.finished_count += len(finished)
        self._lost_in_a_row = 0 if finished else self._lost_in_a_row
        self.steps += len(self)
        return transition

    def state(self) -> dict[str, Any]:
        """State for `restore`, as tensors and plain values."""
        return {
            "next": self._next,
            "steps": self.steps,
            "finished": self.finished_count,
            "lost": self.lost_count,
            "episodes": [
                {
                    "number": episode.number,
                    "seed": episode.seed,
                    "guided": episode.guided,
                    "total": episode.total,
                    "actions": torch.from_numpy(self._stacked(episode.actions)),
                    "digest": _digest(self.observation[rank], episode.total),
                }
                for rank, episode in enumerate(self._episodes)
            ],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores every episode by driving it again.

        Raises:
            SimulationError: An episode differs: the task is not deterministic, or its code has changed.
        """
        self._next, self.steps = state["next"], state["steps"]
        self.finished_count, self.lost_count = state["finished"], state.get("lost", 0)
        self._episodes = [
            Episode(kept["number"], kept["seed"], kept["guided"], 0.0, list(kept["actions"].numpy()))
            for kept in state["episodes"]
        ]
        for seat, episode in zip(self._seats, self._episodes, strict=True):
            seat.send("replay", episode.seed, episode.guided, episode.actions)
        for rank, (seat, kept) in enumerate(zip(self._seats, state["episodes"], strict=True)):
            view, episode = seat.receive(), self._episodes[rank]
            episode.total = view.reward
            self._look(rank, view)
            if _digest(view.observation, view.reward) != kept["digest"]:
                raise SimulationError(
                    f"task '{self._task.name}': episode {episode.number} (seed {episode.seed}), driven again for "
                    f"{len(episode.actions)} steps, comes out otherwise (return {view.reward}, not {kept['total']}): "
                    "the task is not deterministic, or its code has changed since the checkpoint"
                )

    def _driven(self, actions: Array) -> list[View]:
        """One step in all environments; an episode whose simulation fails is truncated, without measures."""
        failed: dict[int, SimulationError] = {}
        for rank, (seat, episode, action) in enumerate(zip(self._seats, self._episodes, actions, strict=True)):
            episode.actions.append(np.array(action))
            try:
                seat.send("step", episode.actions[-1])
            except SimulationError as error:
                failed[rank] = error
        views = []
        for rank, seat in enumerate(self._seats):
            try:
                if rank in failed:
                    raise failed[rank]
                views.append(seat.receive())
            except SimulationError as error:
                self._lose(rank, error)
                views.append(View(self.observation[rank].copy(), truncated=True))
        return views

    def _reset(self, ranks: Iterable[int]) -> None:
        """Begins the episodes of some environments; after a failed simulation the next episode."""
        ranks = list(ranks)
        while ranks:
            for rank in ranks:
                self._seats[rank].send("reset", self._episodes[rank].seed, self._episodes[rank].guided)
            again = []
            for rank in ranks:
                try:
                    self._look(rank, self._seats[rank].receive())
                except SimulationError as error:
                    self._lose(rank, error)
                    self._episodes[rank] = self._next_episode()
                    again.append(rank)
            ranks = again

    def _lose(self, rank: int, error: SimulationError) -> None:
        """Counts a failure of the infrastructure; a single one does not end the run."""
        episode = self._episodes[rank]
        where = f"after {len(episode.actions)} steps" if episode.actions else "at its reset"
        logger.warning("episode %d (seed %d) is lost %s: %s", episode.number, episode.seed, where, error)
        self.lost_count += 1
        self._lost_in_a_row += 1
        if self._lost_in_a_row == MAX_LOST:
            raise error
        self._seats[rank].renew()

    def _next_episode(self) -> Episode:
        number, self._next = self._next, self._next + 1
        draw = np.random.default_rng([_GUIDED, self._seed, number]).random()
        return Episode(number, training_seed(self._seed, number), bool(draw < self.guided_share))

    def _look(self, rank: int, view: View) -> None:
        self.observation[rank], self.expert[rank] = view.observation, view.expert

    def _stacked(self, actions: list[Array]) -> Array:
        space = self._task.action_space
        return np.stack(actions) if actions else np.zeros((0, *space.shape), np.float32)


def _digest(observation: Array, total: float) -> str:
    return hashlib.sha256(np.ascontiguousarray(observation).tobytes() + np.float64(total).tobytes()).hexdigest()
