"""Demonstrations: an expert's episodes as data.

A folder has episodes/NUMBER.safetensors, and demonstrations.json, which is written last and names every episode with
its seed, length, return, success and digest. A folder without it is incomplete, and is refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from gymnasium.spaces import Box, Discrete
from pydantic import ValidationError
from safetensors import SafetensorError
from safetensors.numpy import load, save
from tensordict import TensorDict

from dohyo.agents.learning.experience.behaviour import DEMONSTRATOR, demonstrator
from dohyo.agents.learning.experience.collector import Collector, Finished
from dohyo.agents.learning.experience.replay import Replay
from dohyo.agents.learning.files.card import digest
from dohyo.agents.learning.tasks.environments import check_environments
from dohyo.agents.learning.tasks.task import Array, Task, check_task, named
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.seeds import training_seed

INDEX = "demonstrations.json"
OBSERVATION = "observation."
"""Prefix of an observation's name among an episode's arrays."""
TOLERANCE: Final = 1e-3
"""Share of the width between its bounds by which a demonstrated action may leave them."""


class Entry(Config):
    """An episode of the index.

    Attributes:
        file: Its name in the folder.
        sha256: Digest of the file.
        seed: Of the reset.
        length: Steps, T.
        total: Sum of the rewards.
        success: Whether it succeeded.
        terminated: Whether it ended by itself; otherwise it was truncated.
        measures: The task's measures.
    """

    file: str
    sha256: str
    seed: int
    length: int
    total: float
    success: bool
    terminated: bool
    measures: dict[str, float]


class Index(Config):
    """What is in a folder.

    Attributes:
        task: Its name.
        expert: The expert, in a few words.
        seed: Of the recording; an episode's number and it give the episode's seed.
        episodes: In the order of their end.
    """

    task: str
    expert: str
    seed: int
    episodes: tuple[Entry, ...]


def record_demonstrations(
    task: Task,
    folder: Path,
    episodes: int,
    *,
    expert: str,
    seed: int = 0,
    processes: int = 0,
    environments: int = 1,
    successes_only: bool = False,
) -> Demonstrations:
    """Records whole episodes that the task's expert drives.

    Args:
        task: With an expert.
        folder: Of the demonstrations; it must not hold any yet.
        episodes: Number to be recorded.
        expert: The expert, in a few words.
        seed: Decides the episodes.
        processes: Environments, one process each; 0: all in this process.
        environments: Environments without processes.
        successes_only: Leaves out episodes without success.

    Raises:
        InvalidInputError: The folder holds demonstrations, the task has no expert, or the expert is silent in ten
            episodes, or without success, for every one that is recorded.
        SimulationError: Simulations fail again and again.
    """
    check_task(task)
    if (folder / INDEX).exists():
        raise InvalidInputError(f"'{folder}' holds demonstrations already; choose another folder")
    if not task.has_expert:
        raise InvalidInputError(f"task '{task.name}' has no expert to record")
    made = task.make_environments(processes or environments, processes=processes > 0)
    try:
        check_environments(made)
        recorder = _Recorder(Collector(made, task, seed), folder, seed)
        while len(recorder.entries) < episodes:
            recorder.step(successes_only)
            if recorder.left_out > 10 * episodes:
                raise InvalidInputError(
                    f"task '{task.name}': expected {episodes} episodes of the expert, got {len(recorder.entries)} "
                    f"where {recorder.left_out} were left out"
                )
    finally:
        made.close()
    index = Index(task=task.name, expert=expert, seed=seed, episodes=tuple(recorder.entries[:episodes]))
    write_atomically(folder / INDEX, (index.model_dump_json(indent=1) + "\n").encode())
    return Demonstrations(folder)


class _Recorder:
    """Writes the episodes of a collector's rows as they end."""

    def __init__(self, collector: Collector, folder: Path, seed: int) -> None:
        self._collector, self._folder, self._seed = collector, folder, seed
        space = collector.action_space
        blank = torch.from_numpy(np.zeros((len(collector), *(space.shape or ())), space.dtype))
        self._behaviour = demonstrator(lambda seen: TensorDict({"action": blank.clone()}, seen.batch_size))
        self._steps: list[list[TensorDict]] = [[] for _ in range(len(collector))]
        self.entries: list[Entry] = []
        self.left_out = 0
        (folder / "episodes").mkdir(parents=True, exist_ok=True)

    def step(self, successes_only: bool) -> None:
        """Takes one step in all rows."""
        step = self._collector.step(self._behaviour)
        finished = {episode.row: episode for episode in self._collector.finished()}
        for row in torch.nonzero(step["active"]).flatten().tolist():
            self._steps[row].append(step[row])
        for row in torch.nonzero(step["next", "done"][:, 0]).flatten().tolist():
            steps, self._steps[row] = self._steps[row], []
            ended = finished.get(row)  # None: its simulation was lost
            wanted = ended is not None and ended.demonstrated == 1.0 and (ended.success or not successes_only)
            if ended is not None and wanted:
                self.entries.append(self._write(steps, ended))
            self.left_out += not wanted

    def _write(self, steps: list[TensorDict], ended: Finished) -> Entry:
        episode = TensorDict.stack(steps)
        last = episode["next", "observation"][-1:]
        seen = TensorDict.cat([episode["observation"], last])
        arrays = {f"{OBSERVATION}{name}": array.numpy() for name, array in seen.items()}
        arrays |= {"action": episode["action"].numpy(), "reward": episode["next", "reward"][:, 0].numpy()}
        path = self._folder / "episodes" / f"{len(self.entries):06d}.safetensors"
        write_atomically(path, save({name: np.ascontiguousarray(array) for name, array in arrays.items()}))
        return Entry(
            file=f"episodes/{path.name}",
            sha256=digest(path),
            seed=training_seed(self._seed, int(episode["episode"][0])),
            length=ended.length,
            total=ended.total,
            success=ended.success,
            terminated=bool(episode["next", "terminated"][-1, 0]),
            measures=dict(ended.measures),
        )


class Demonstrations:
    """Recorded episodes of an expert.

    Attributes:
        index: What is in the folder.
    """

    def __init__(self, folder: Path) -> None:
        """Reads the index.

        Raises:
            InvalidInputError: There are no demonstrations, or the index is damaged.
        """
        self._folder = folder
        try:
            self.index = Index.model_validate_json((folder / INDEX).read_bytes())
        except OSError as error:
            raise InvalidInputError(f"no demonstrations in '{folder}': {error.strerror}") from error
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise InvalidInputError(f"'{folder / INDEX}': {where}: {first['msg']}") from error

    def __len__(self) -> int:
        """Number of episodes."""
        return len(self.index.episodes)

    @cached_property
    def highest_reward(self) -> float:
        """Highest reward of a recorded step."""
        return max(float(self.episode(number)["reward"].max()) for number in range(len(self)))

    def check(self, task: Task) -> None:
        """Reads all episodes, and compares them with the spaces of the task that is to be learned from them.

        Raises:
            InvalidInputError: There is no episode, a file is missing or not that of the index, or a column is missing,
                surplus, of another type, shape or length than the task's, not finite, or has actions that are out of
                bounds by more than `TOLERANCE`. The message names file and column.
        """
        if not len(self):
            raise InvalidInputError(f"'{self._folder / INDEX}': expected at least one episode, got none")
        for number, entry in enumerate(self.index.episodes):
            _check_columns(f"'{self._folder / entry.file}'", self.episode(number), entry.length, task)

    def episode(self, number: int) -> dict[str, Array]:
        """Arrays of an episode: "observation.NAME" (T + 1, ...), "action" (T, ...) and "reward" (T,).

        Raises:
            InvalidInputError: The file is missing, not that of the index, or no safetensors.
        """
        entry = self.index.episodes[number]
        path = self._folder / entry.file
        if not path.is_file() or digest(path) != entry.sha256:
            raise InvalidInputError(f"'{path}': expected the file that {INDEX} names, got another one, or none")
        try:
            return load(path.read_bytes())
        except SafetensorError as error:
            raise InvalidInputError(f"'{path}': expected safetensors: {error}") from error

    def transitions(self, numbers: range | None = None) -> TensorDict:
        """Transitions of some episodes, in memory; by default of all.

        Returns:
            (B,) in TorchRL's form: "observation", "action", "episode" (its number here), and under "next" the
            observation, "reward", "terminated", "truncated" and "done" (B, 1).
        """
        parts = [self._transitions(number) for number in (range(len(self)) if numbers is None else numbers)]
        return TensorDict.cat(parts)

    def split(self, share: float) -> tuple[TensorDict, TensorDict]:
        """Transitions of the first episodes, and those of a share of episodes at the end, at least one.

        Raises:
            InvalidInputError: There are fewer than two episodes.
        """
        if len(self) < 2:
            raise InvalidInputError(f"'{self._folder}': expected at least 2 episodes to hold one out, got {len(self)}")
        first = min(max(round(len(self) * (1.0 - share)), 1), len(self) - 1)
        return self.transitions(range(first)), self.transitions(range(first, len(self)))

    def feed(self, replay: Replay, number: int, reward: float | None = None) -> None:
        """Adds an episode to a replay, tagged as the demonstrator's.

        Args:
            replay: Of the same spaces.
            number: Of the episode.
            reward: Of every step (GRI's r_demo); None: the recorded rewards.
        """
        entry, arrays = self.index.episodes[number], self.episode(number)
        rewards = arrays["reward"] if reward is None else np.full(entry.length, reward, np.float32)
        seen = _observations(arrays)
        replay.add_episode(seen, arrays["action"], rewards, terminated=entry.terminated, source=DEMONSTRATOR)

    def _transitions(self, number: int) -> TensorDict:
        entry, arrays = self.index.episodes[number], self.episode(number)
        seen = TensorDict(_observations(arrays), [entry.length + 1])
        last = (torch.arange(entry.length) == entry.length - 1)[:, None]
        after = {
            "observation": seen[1:],
            "reward": torch.from_numpy(arrays["reward"])[:, None],
            "terminated": last & entry.terminated,
            "truncated": last & (not entry.terminated),
            "done": last,
        }
        rows = {"observation": seen[:-1], "action": arrays["action"], "episode": torch.full((entry.length,), number)}
        return TensorDict({**rows, "next": after}, [entry.length])


def _check_columns(file: str, arrays: Mapping[str, Array], length: int, task: Task) -> None:
    """Raises InvalidInputError, with the file's name, if the columns of `length` steps do not fit a task."""
    expected: dict[str, tuple[tuple[int, ...], np.dtype[Any]]] = {
        f"{OBSERVATION}{name}": ((length + 1, *(box.shape or ())), np.dtype(box.dtype))
        for name, box in named(task.observation_space).spaces.items()
    }
    actions = task.action_space
    expected |= {"action": ((length, *(actions.shape or ())), np.dtype(actions.dtype))}
    expected |= {"reward": ((length,), np.dtype(np.float32))}
    if arrays.keys() != expected.keys():
        raise InvalidInputError(f"{file}: expected the columns {sorted(expected)}, got {sorted(arrays)}")
    for name, (shape, dtype) in expected.items():
        array = arrays[name]
        if (array.shape, array.dtype) != (shape, dtype):
            raise InvalidInputError(
                f"{file}: expected column '{name}' to be {dtype} {shape} for an episode of {length} steps of "
                f"'{task.name}', got {array.dtype} {array.shape}"
            )
        if not np.isfinite(array).all():
            raise InvalidInputError(f"{file}: expected finite numbers in column '{name}', got others")
    _check_bounds(f"{file}: column 'action'", arrays["action"], actions)


def _check_bounds(column: str, chosen: Array, actions: Box | Discrete) -> None:
    """Raises InvalidInputError if one of (T, ...) actions is out of bounds."""
    if isinstance(actions, Discrete):
        low, high, slack = np.array(0), np.array(int(actions.n) - 1), np.array(0.0)
    else:
        low, high = actions.low.astype(np.float64), actions.high.astype(np.float64)
        slack = TOLERANCE * (high - low)
    wrong = (chosen < low - slack) | (chosen > high + slack)
    if wrong.any():
        step = int(np.argwhere(wrong)[0, 0])
        raise InvalidInputError(f"{column}: expected actions in {actions}, got {chosen[step].tolist()} in step {step}")


def _observations(arrays: Mapping[str, Array]) -> dict[str, Array]:
    """(T + 1, ...) observations by name."""
    return {name.removeprefix(OBSERVATION): array for name, array in arrays.items() if name.startswith(OBSERVATION)}
