"""Collector: steps environments by a behaviour, begins the run's episodes, and cuts them at checkpoints."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor

from dohyo.agents.learning.experience.behaviour import POLICY, Behaviour
from dohyo.agents.learning.files.metrics import Number
from dohyo.agents.learning.tasks.curriculum import Progress
from dohyo.agents.learning.tasks.task import Array, Environments, Task
from dohyo.sumo_networks.arrays import BoolArray
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.seeds import training_seed

logger = logging.getLogger(__name__)

MAX_LOST = 5
"""Number of consecutive lost episodes that ends a run."""
EVERY = slice(0, None, 1)
"""Numbers of the episodes of a run with one collector."""


class Finished(NamedTuple):
    """An episode that has ended.

    Attributes:
        row: That drove it.
        demonstrated: Share of its steps that the policy did not drive.
        total: Sum of its rewards.
        length: Its steps.
        level: Of the curriculum.
        success: Whether it succeeded.
        measures: The task's measures.
    """

    row: int
    demonstrated: float
    total: float
    length: int
    level: int
    success: bool
    measures: Mapping[str, float]


def outcome(episodes: Sequence[Finished]) -> dict[str, Number]:
    """Mean return, length [steps] and success [%] of some episodes; None without any."""

    def mean(values: Iterable[float]) -> float | None:
        return math.fsum(values) / len(episodes) if episodes else None

    return {
        "return": mean(episode.total for episode in episodes),
        "length": mean(episode.length for episode in episodes),
        "success": mean(100.0 * episode.success for episode in episodes),
    }


class Collector:
    """N rows that step together. A row whose episode ends begins the run's next episode.

    An episode's number decides its seed. At a cut, which falls on a number of steps, every running episode is
    truncated, and all rows begin new ones: nothing of an environment has to be kept in a checkpoint. What was cut is in
    no mean, and neutral for a curriculum, see `Progress`.

    A row may sit out some steps before it begins, while its simulation starts and the others act. It begins after a
    number of steps, whenever the simulation is ready, so that the same run has the same steps.

    Attributes:
        observation: By name, (N, ...), to act on now.
        steps: Taken so far, of all rows together.
        finished_count: Episodes that have ended.
        lost_count: Episodes whose simulation failed.
        cut_at: The first round that ends at this number of steps or later ends with a cut.
        level: Of the curriculum, of episodes that begin now.
        group_size: Rows of one simulation, which are reset together.
    """

    def __init__(
        self, environments: Environments, task: Task, seed: int, begin_after: int = 0, numbers: slice = EVERY
    ) -> None:
        """Prepares; the first episodes begin with the first step.

        Args:
            environments: See `environments.check_environments`.
            task: Of them.
            seed: Of the run.
            begin_after: Steps that a row sits out, see the class; 0: all rows wait for the one that begins.
            numbers: Start and step of the episodes' numbers, where several collectors share a run.
        """
        self._environments, self._task, self._seed = environments, task, seed
        self._begin_after, count = begin_after, environments.num_envs
        self.group_size: int = getattr(environments, "group_size", 1)
        self._asynchronous = hasattr(environments, "step_async")
        self.observation: dict[str, Array] = {}
        self._next, self._stride = numbers.start, numbers.step
        self.steps, self.finished_count, self.lost_count = 0, 0, 0
        self._lost_in_a_row, self.cut_at, self._left = 0, 0, 0
        self._progress = Progress(task.curriculum)
        self._finished: list[Finished] = []
        self._fresh = True  # whether all rows begin new episodes before the next step
        self._over = np.ones(count, np.bool_)  # rows whose episode has ended, while others of their group go on
        self._starting = np.zeros(count, np.bool_)  # rows that sit out
        self._begun = np.zeros(count, np.bool_)  # rows whose episode the behaviour does not know yet
        self._numbers, self._levels = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self._lengths, self._demonstrated = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self._totals = np.zeros(count)
        self._actions: Array = np.zeros(0)
        self._seen = TensorDict({}, [count])
        self._unlabelled = self._no_labels()  # of a task without an expert; no step keeps them
        self._chosen: dict[str, Any] = {}  # what is known of the next transitions before the environments answer

    @property
    def action_space(self) -> Any:
        """Space of one row's action."""
        return self._environments.single_action_space

    def __len__(self) -> int:
        return self._environments.num_envs

    @property
    def level(self) -> int:
        """See the class."""
        return self._progress.level

    @property
    def cut(self) -> bool:
        """Whether the last step ended with a cut: a checkpoint can be written now."""
        return self._fresh

    def begin(self) -> None:
        """Begins new episodes in all rows; running ones are forgotten."""
        self._fresh = False
        self._progress.cut()
        self._reset(np.ones(len(self), np.bool_))

    def round(self, length: int) -> range:
        """Begins a round, whose last step may be a cut; to be iterated over."""
        self._left = length
        return range(length)

    def step(self, behaviour: Behaviour) -> TensorDict:
        """Takes one step in all rows; see `send` and `receive`."""
        self.send(behaviour)
        return self.receive()

    def send(self, behaviour: Behaviour) -> None:
        """Chooses the actions of the next step; environments in processes begin it.

        Raises:
            DohyoError: As from `receive`.
        """
        if self._fresh:
            self.begin()
        if self._begun.any():
            behaviour.begin(self._begun, self._numbers)
            self._begun[:] = False
        label, labelled = self._labels(behaviour) if self._task.has_expert else self._unlabelled
        chosen = dict(behaviour.act(self.seen, label, labelled).items())
        self._actions = chosen["action"].numpy()
        if self._asynchronous:
            self._environments.step_async(self._actions)  # type: ignore[attr-defined]
        chosen |= {"observation": self.seen, "episode": torch.from_numpy(self._numbers.copy())}
        if self._task.has_expert:
            chosen |= {"label": label, "labelled": labelled}
        self._chosen = chosen

    def receive(self) -> TensorDict:
        """Waits for the end of the step, and begins new episodes where they ended.

        Returns:
            (N,) in TorchRL's form: "observation", "action", "source", "episode", "active" (whether the row acted), the
            behaviour's own entries, "label" and "labelled" if the task has an expert, and under "next" the observation
            after the step (an episode's last one at its end), "reward", "terminated", "truncated" and "done" (N, 1).

        Raises:
            EnvError: The task's code failed.
            SimulationError: Simulations fail again and again; if one does, its episode is cut off and the next begins.
        """
        observation, reward, terminated, truncated, infos = self._answer()
        self._see(observation)
        lost = ~self._over & infos.get("lost", False)
        # A step in which the simulation failed has no outcome to learn from.
        active = ~self._over & infos.get("active", True) & ~lost
        terminated, truncated = terminated & active, (truncated & active) | lost
        self._count(reward, active)
        cut = self._cuts()
        ended = terminated | truncated
        after = self._after(reward, terminated, truncated | (active & ~terminated) if cut else truncated)
        step = _rows({**self._chosen, "active": torch.from_numpy(active), "next": after}, len(self))
        if ended.any():
            self._finish(ended & ~lost, infos)
            self._lose(lost)
            self._over |= ended
        if self._over.any() and not cut:
            failed = self._start(infos)
            over = (self._over & ~self._starting).reshape(-1, self.group_size).all(axis=1)
            self._reset(failed | np.repeat(over, self.group_size))
        self._fresh = cut
        return step

    def received(self) -> Iterator[TensorDict]:
        """The one step that `receive` waits for, as what is learned from a step at a time."""
        yield self.receive()

    def finished(self) -> list[Finished]:
        """Hands over the episodes that have ended since the last call."""
        finished, self._finished = self._finished, []
        return finished

    @property
    def seen(self) -> TensorDict:
        """(N,) present observations by name, which later steps leave as they are."""
        return self._seen

    def state(self) -> dict[str, Any]:
        """State for `restore`, after a cut."""
        return {
            "next": self._next,
            "steps": self.steps,
            "finished": self.finished_count,
            "lost": self.lost_count,
            "progress": self._progress.state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state; new episodes begin with the next step."""
        self._next, self.steps = state["next"], state["steps"]
        self.finished_count, self.lost_count = state["finished"], state["lost"]
        self._progress.restore(state["progress"])
        self._fresh = True

    def _see(self, observation: dict[str, Array]) -> None:
        self.observation = observation
        self._seen = _rows({name: torch.from_numpy(one) for name, one in observation.items()}, len(self))

    def _labels(self, behaviour: Behaviour) -> tuple[Tensor, Tensor]:
        """(N, ...) the expert's actions, and (N,) whether it gave one."""
        rows = behaviour.asked(len(self)) & ~self._over
        if not rows.any():
            return self._no_labels()
        labels, known = self._environments.expert_actions(rows)  # type: ignore[attr-defined]
        return torch.from_numpy(labels), torch.from_numpy(known & rows)

    def _no_labels(self) -> tuple[Tensor, Tensor]:
        shape = self._environments.single_action_space.shape or ()
        return torch.zeros((len(self), *shape)), torch.zeros(len(self), dtype=torch.bool)

    def _answer(self) -> Any:
        if self._asynchronous:
            return self._environments.step_wait()  # type: ignore[attr-defined]
        return self._environments.step(self._actions)

    def _count(self, reward: Array, active: BoolArray) -> None:
        self._totals += np.where(active, reward, 0.0)
        self._lengths += active
        self._demonstrated += active & (self._chosen["source"].numpy() != POLICY)
        self.steps += int(np.count_nonzero(active))
        self._left -= 1

    def _cuts(self) -> bool:
        return self._left == 0 and self.steps >= self.cut_at > 0

    def _after(self, reward: Array, terminated: BoolArray, truncated: BoolArray) -> TensorDict:
        after = {"reward": np.asarray(reward, np.float32), "terminated": terminated, "truncated": truncated}
        after["done"] = terminated | truncated
        columns = {name: torch.from_numpy(column[:, None]) for name, column in after.items()}
        return _rows({"observation": self.seen, **columns}, len(self))

    def _finish(self, rows: BoolArray, infos: Mapping[str, Any]) -> None:
        for row in np.flatnonzero(rows).tolist():
            length, level = int(self._lengths[row]), int(self._levels[row])
            demonstrated = float(self._demonstrated[row]) / length
            success = bool(infos["success"][row]) if "success" in infos else False
            measures = {name: float(infos[name][row]) for name in self._task.measures}
            total = float(self._totals[row])
            self._finished.append(Finished(row, demonstrated, total, length, level, success, measures))
            self._progress.end(row, None if demonstrated else success)
            self.finished_count += 1
            self._lost_in_a_row = 0

    def _lose(self, rows: BoolArray) -> None:
        """Counts failed simulations; a single one does not end the run."""
        for row in np.flatnonzero(rows).tolist():
            self._progress.end(row, None)
        groups = np.flatnonzero(rows.reshape(-1, self.group_size).any(axis=1)) * self.group_size
        for row in groups.tolist():
            length = int(self._lengths[row])
            where = f"after {length} steps" if length else "at its reset"
            number = int(self._numbers[row])
            logger.warning("episode %d (seed %d) is lost %s", number, training_seed(self._seed, number), where)
            self.lost_count += 1
            self._lost_in_a_row += 1
            if self._lost_in_a_row >= MAX_LOST:
                raise SimulationError(
                    f"task '{self._task.name}': {MAX_LOST} episodes were lost without one that ended, the last with "
                    f"seed {training_seed(self._seed, number)} {where}; the log has the causes"
                )

    def _reset(self, rows: BoolArray) -> None:
        """Begins the next episodes in some rows, group by group; after a failed simulation the one after it."""
        while rows.any():
            groups = np.flatnonzero(rows.reshape(-1, self.group_size).any(axis=1))
            for group in groups.tolist():
                members = slice(group * self.group_size, (group + 1) * self.group_size)
                self._numbers[members], self._next = self._next, self._next + self._stride
            for row in np.flatnonzero(rows).tolist():
                self._progress.end(row, None)  # of a group whose simulation failed while it started
            numbers = self._numbers.tolist()
            seeds = [training_seed(self._seed, numbers[row]) if rows[row] else None for row in range(len(self))]
            options: dict[str, Any] = {"reset_mask": rows.copy()}
            if self._task.curriculum is not None:
                options["level"] = self.level
            if self._begin_after:
                options["begin_after"] = self._begin_after
            observation, infos = self._environments.reset(seed=seeds, options=options)  # type: ignore[arg-type]
            self._see(observation)
            self._levels[rows] = self.level
            for row in np.flatnonzero(rows).tolist():
                self._progress.begin(row)
            self._totals[rows], self._lengths[rows], self._demonstrated[rows] = 0.0, 0, 0
            self._over[rows], self._starting[rows] = True, True
            rows = self._start(infos)

    def _start(self, infos: Mapping[str, Any]) -> BoolArray:
        """Lets the rows act whose simulation has begun; (N,) rows of those that failed, to be reset again."""
        lost = self._starting & infos.get("lost", False)
        begun = self._starting & infos.get("begun", True) & ~lost
        self._over[begun], self._begun[begun] = False, True
        self._starting &= ~(begun | lost)
        self._lose(lost)
        return np.repeat(lost.reshape(-1, self.group_size).any(axis=1), self.group_size)


def _rows(entries: dict[str, Any], count: int) -> TensorDict:
    """(N,) entries, unchecked, as TorchRL's own environments make theirs: checks take a tenth of a step in SUMO."""
    return TensorDict._new_unsafe(entries, torch.Size([count]))
