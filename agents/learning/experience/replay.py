"""Replay: a memory-mapped ring of frames, sampled as transitions.

An entry is one observation, and, once the agent has acted on it, the action and its outcome. The next observation is
the entry that follows in the same episode, so that every frame is stored once; an episode's last observation is an
entry without an action. Returns of n steps and stacks of frames are gathered when a batch is drawn, along the links.

Entries are numbered by position, in the order of their arrival; position p is in slot p modulo the ring's size. The
newest `capacity` positions are the window that batches are drawn from. The rest of the ring is slack: what a run adds
after its last two checkpoints overwrites nothing of their windows, so a checkpoint holds counters and no frames.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from gymnasium import Space
from gymnasium.spaces import Dict
from pydantic import Field
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from dohyo.agents.learning.experience.disk_room import check_disk_room, reserve
from dohyo.agents.learning.experience.sum_tree import SumTree
from dohyo.agents.learning.files.checkpoint import KEPT
from dohyo.agents.learning.tasks.task import Array
from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError

NOWHERE = -1
"""Position that is none: behind an entry without an action."""
LEAST_PRIORITY = 1e-6
"""Added to every error, so that no transition's priority is 0."""
RESERVED = 1024
"""Entries whose blocks on the disk are reserved at once."""
_BATCHES = 4  # separates this random stream from those of seeds, and from torch's own of weights and noise


class ReplayConfig(Config):
    """Settings of a replay.

    Attributes:
        capacity: Observations in the window.
        steps: n of the n-step return.
        priority: Exponent of the priorities; 0: uniform sampling (Schaul et al. 2016: 0.6).
        correction: Exponent of the importance weights, with priorities (Schaul et al. 2016: 0.4 at the start).
    """

    capacity: Annotated[int, Field(gt=0)] = 1_000_000
    steps: Annotated[int, Field(gt=0)] = 1
    priority: Annotated[float, Field(ge=0, le=1)] = 0.0
    correction: Annotated[float, Field(ge=0, le=1)] = 0.4


class Replay:
    """Transitions of any number of producers, each tagged with its source."""

    def __init__(
        self,
        folder: Path,
        spaces: tuple[Dict, Space[Any]],
        config: ReplayConfig,
        *,
        gamma: float,
        slack: int,
        seed: int,
        stack: int = 1,
        extras: Mapping[str, Tensor] | None = None,
        entries: int | None = None,
    ) -> None:
        """Prepares; the files are made with the first entry.

        Args:
            folder: Of the memory map.
            spaces: Of one observation and one action of the steps.
            config: Settings.
            gamma: Discount per step, for returns of n steps.
            slack: Entries that may be added between a checkpoint and the second one after it.
            seed: Of the batches.
            stack: Pictures (k C, H, W) of the steps are stacks of k frames, of which the last is new.
            extras: What else of a step is stored and sampled, by name, with one row's value; steps without it hold 0.
            entries: That the run will add from its beginning to its end, at least; None: they fill the ring.

        Raises:
            InvalidInputError: The disk has no room for them.
        """
        self._folder, self._config, self._gamma, self._stack = folder, config, gamma, stack
        self._size = config.capacity + slack
        self._blank = _blank(*spaces, stack, extras or {})
        needed = self._blank.bytes() * min(self._size, entries or self._size)
        check_disk_room(folder, needed, f"a smaller replay.capacity (now {config.capacity}) needs less")
        self._extras = tuple(extras or ())
        self._head = 0  # position of the next entry
        self._protected: deque[int] = deque(maxlen=KEPT)  # first position of the window, at each checkpoint kept
        self._generator = torch.Generator().manual_seed(_stream(seed))
        self._trees: dict[int, SumTree] = {}  # by source, over slots
        self._top_priority = 1.0
        self._open: IntArray = np.zeros(0, np.int64)  # (N,) position of the entry that each row acts on next
        self._open_episode: IntArray = np.zeros(0, np.int64)  # (N,) its episode
        self._reserved = 0  # slots whose blocks are reserved, in this session
        self._columns: dict[str, Tensor] = {}  # (size, ...) by name; observations begin with "observation."
        self._arrays: dict[str, Array] = {}  # the same memory, for small writes

    def __len__(self) -> int:
        """Entries in the window, with the last observations of episodes."""
        return self._head - self._start

    def share(self, source: int) -> float:
        """Probability that a transition is of a source, where no shares are asked for."""
        total = sum(tree.total for tree in self._trees.values())
        return self._trees[source].total / total if source in self._trees and total else 0.0

    @property
    def _start(self) -> int:
        """First position of the window."""
        return max(0, self._head - self._config.capacity)

    # Adding

    def add(self, step: TensorDictBase) -> None:
        """Adds a step of the collector.

        Args:
            step: (N,) see `Collector.receive`. Rows that did not act are left out; what such a row does later is
                a new chain of transitions.

        Raises:
            InvalidInputError: The slack is too small, or the window for so many rows.
        """
        rows = np.flatnonzero(step["active"].numpy())
        episodes = step["episode"].numpy()
        if not len(self._open):
            self._open, self._open_episode = np.full(len(episodes), NOWHERE), np.full(len(episodes), NOWHERE)
        beginning = rows[(self._open[rows] == NOWHERE) | (self._open_episode[rows] != episodes[rows])]
        self._make_room(len(beginning) + len(rows))
        self._open[beginning] = self._enter(self._frames(step, beginning), beginning, episodes[beginning], None)
        here, follows = self._open[rows], step["next"]
        after = self._enter(self._frames(follows, rows), rows, episodes[rows], here)
        facts = {name: step[name] for name in ("action", "source", *self._extras) if name in step}
        facts |= {name: follows[name].squeeze(-1) for name in ("reward", "terminated", "truncated")}
        self._act(here, after, {name: column.numpy()[rows] for name, column in facts.items()})
        done = follows["done"].numpy()[rows, 0]
        self._open[:] = NOWHERE
        self._open[rows], self._open_episode[rows] = np.where(done, NOWHERE, after), episodes[rows]

    def add_episode(
        self,
        observations: Mapping[str, Array],
        actions: Array,
        rewards: Array,
        *,
        terminated: bool,
        source: int,
        episode: int = NOWHERE,
        extras: Mapping[str, Array] | None = None,
    ) -> None:
        """Adds a whole episode of T steps, such as a recorded demonstration.

        Args:
            observations: By name, (T + 1, ...); single frames, also where steps hold stacks.
            actions: (T, ...) in the action space.
            rewards: (T,).
            terminated: Whether the last observation is terminal; otherwise the episode was truncated.
            source: Its tag.
            episode: Its number.
            extras: (T, ...) by name.

        Raises:
            InvalidInputError: The slack or the window is too small for it.
        """
        count, last = len(actions), np.arange(len(actions)) == len(actions) - 1
        self._make_room(count + 1)
        positions = self._head + np.arange(count + 1)
        frames = {f"observation.{name}": frame for name, frame in observations.items()}
        rows, episodes = np.full(count + 1, NOWHERE), np.full(count + 1, episode)
        self._enter(frames, rows, episodes, np.maximum(positions - 1, positions[0]))
        ends = {"terminated": last & terminated, "truncated": last & (not terminated)}
        facts = {"action": actions, "reward": rewards, "source": np.full(count, source, np.uint8), **ends}
        self._act(positions[:-1], positions[1:], facts | dict(extras or {}))

    def _frames(self, step: TensorDictBase, rows: IntArray) -> dict[str, Array]:
        """Newest frames of some rows."""
        frames = {f"observation.{name}": column.numpy()[rows] for name, column in step["observation"].items()}
        return {name: _newest(frame, self._stack) for name, frame in frames.items()}

    def _enter(
        self, frames: Mapping[str, Array], rows: IntArray, episodes: IntArray, before: IntArray | None
    ) -> IntArray:
        """Appends observations, nothing done on them yet; returns their positions.

        Args:
            frames: By column, (B, ...).
            rows: (B,).
            episodes: (B,).
            before: (B,) positions of the entries before them in their episodes; None: they are the first.
        """
        positions = self._head + np.arange(len(rows))
        slots = positions % self._size
        facts = {"row": rows, "episode": episodes, "before": positions if before is None else before, "after": NOWHERE}
        for name, values in (*frames.items(), *facts.items()):
            self._arrays[name][slots] = values
        left = np.arange(self._start, max(0, self._head + len(rows) - self._config.capacity)) % self._size
        self._head += len(rows)
        for tree in self._trees.values():
            tree.set(left, 0.0)
        return positions

    def _act(self, here: IntArray, after: IntArray, facts: Mapping[str, Array]) -> None:
        """Makes entries transitions.

        Args:
            here: (B,) their positions.
            after: (B,) positions of the observations after them.
            facts: By column, (B, ...).
        """
        inside = here >= self._start  # episodes of another producer may have taken the place of a row's last entry
        slots = here[inside] % self._size
        self._arrays["after"][slots] = after[inside]
        for name in self._extras:
            self._arrays[name][slots] = 0
        for name, values in facts.items():
            self._arrays[name][slots] = values[inside]
        sources = facts["source"][inside]
        for source in np.unique(sources).tolist():
            self._tree(source).set(slots[sources == source], self._top_priority**self._config.priority)

    def _tree(self, source: int) -> SumTree:
        if source not in self._trees:
            self._trees[source] = SumTree(self._size)
        return self._trees[source]

    def _make_room(self, count: int) -> None:
        """Checks that `count` entries overwrite nothing that is needed, and gives them files and blocks on the disk."""
        if count > self._config.capacity // 2:
            raise InvalidInputError(
                f"replay: expected a capacity of at least {2 * count}, for {count} entries at once, "
                f"got {self._config.capacity}"
            )
        if self._protected and self._head + count - self._size > min(self._protected):
            raise InvalidInputError(
                f"replay: expected a slack for all that is added between two checkpoints, got "
                f"{self._size - self._config.capacity} entries"
            )
        if not self._columns:
            # As in TorchRL's LazyMemmapStorage, whose own length and cursor do not fit a ring with links.
            self._use(self._blank.expand(self._size).memmap_like(prefix=str(self._folder), existsok=True))
        if (used := min(self._head + count, self._size)) > self._reserved:
            first, self._reserved = self._reserved, min(used + RESERVED, self._size)
            sizes = {self._folder / f"{name}.memmap": array[0].nbytes for name, array in self._arrays.items()}
            reserve((path, first * size, (self._reserved - first) * size) for path, size in sizes.items())

    def _use(self, entries: TensorDictBase) -> None:
        # Plain tensors: those of the memory map look up a dispatcher in every operation.
        self._arrays = {str(name): column.numpy() for name, column in entries.items()}
        self._columns = {name: torch.from_numpy(array) for name, array in self._arrays.items()}

    # Sampling

    def sample(self, count: int, shares: Mapping[int, float] | None = None) -> TensorDict:
        """Draws transitions, with replacement.

        Args:
            count: Size of the batch, B.
            shares: Part of the batch that comes from a source; the rest comes from the other sources. A source without
                transitions gives up its share.

        Returns:
            (B,) in TorchRL's form: "observation", "action", "source", "episode", the extras, "index" (positions),
            "weight" with priorities, and under "next" the observation after n steps or at the episode's end, "reward"
            (the discounted sum up to it), "terminated", "done", and "steps_to_next_obs" (the number of steps) (B, 1).

        Raises:
            InvalidInputError: There is no transition yet.
        """
        here, weights = self._draw(count, shares or {})
        last, rewards, steps = self._walk(here)
        slots = here % self._size
        terminated = _taken(self._columns["terminated"], last)
        extras = {name: _taken(self._columns[name], slots) for name in ("action", "source", "episode", *self._extras)}
        if weights is not None:
            extras["weight"] = torch.from_numpy(weights)
        following = TensorDict(
            {
                "observation": self._seen(self._arrays["after"][last]),
                "reward": torch.from_numpy(rewards)[:, None],
                "terminated": terminated[:, None],
                "done": (terminated | _taken(self._columns["truncated"], last))[:, None],
                "steps_to_next_obs": torch.from_numpy(steps)[:, None],
            },
            [count],
        )
        batch = {"observation": self._seen(here), "index": torch.from_numpy(here), "next": following, **extras}
        return TensorDict(batch, [count])

    def prioritise(self, index: Tensor, errors: Tensor) -> None:
        """Sets priorities; without effect if sampling is uniform.

        Args:
            index: (B,) positions, from a batch.
            errors: (B,) or (B, 1) temporal-difference errors.
        """
        if not self._config.priority:
            return
        positions = index.cpu().numpy()
        priorities = errors.detach().cpu().double().flatten().abs().numpy() + LEAST_PRIORITY
        self._top_priority = max(self._top_priority, float(priorities.max()))
        inside = positions >= self._start  # newer entries may have taken the place of others
        slots, weights = positions[inside] % self._size, priorities[inside] ** self._config.priority
        sources = self._arrays["source"][slots]
        for source, tree in self._trees.items():
            tree.set(slots[sources == source], weights[sources == source])

    def _draw(self, count: int, shares: Mapping[int, float]) -> tuple[IntArray, Array | None]:
        """(B,) positions of transitions, and (B,) their importance weights if there are priorities."""
        filled = [source for source, tree in sorted(self._trees.items()) if tree.total > 0.0]
        if not filled:
            raise InvalidInputError("replay: expected at least one transition to sample from, there is none")
        parts = [([source], round(share * count)) for source, share in shares.items() if source in filled]
        others = [source for source in filled if source not in shares] or filled
        parts.append((others, count - sum(part for _, part in parts)))
        drawn = [self._drawn_from(sources, part) for sources, part in parts if part > 0]
        slots = np.concatenate([slots for slots, _ in drawn])
        here = self._head - 1 - (self._head - 1 - slots) % self._size
        if not self._config.priority:
            return here, None
        corrections = [weights**-self._config.correction for _, weights in drawn]
        return here, np.concatenate([part / part.max() for part in corrections]).astype(np.float32)

    def _drawn_from(self, sources: Sequence[int], count: int) -> tuple[IntArray, FloatArray]:
        """(B,) slots from some sources, in proportion to their weights, and (B,) those weights."""
        trees = [self._trees[source] for source in sources]
        ends = np.cumsum([tree.total for tree in trees])
        masses = torch.rand(count, dtype=torch.float64, generator=self._generator).numpy() * ends[-1]
        owners = np.searchsorted(ends, masses, side="right")
        slots, weights = np.empty(count, np.int64), np.empty(count)
        for index, tree in enumerate(trees):
            mine = owners == index
            slots[mine] = tree.find(masses[mine] - (ends[index - 1] if index else 0.0))
            weights[mine] = tree.weights(slots[mine])
        return slots, weights

    def _walk(self, here: IntArray) -> tuple[IntArray, Array, IntArray]:
        """Goes n steps from (B,) positions, or to the end of what is known of their episodes.

        Returns:
            (B,) slots of the last transitions, (B,) discounted sums of rewards, (B,) numbers of steps.
        """
        after, reward = self._arrays["after"], self._arrays["reward"]
        last = here % self._size
        rewards, steps, goes_on = reward[last], np.ones(len(here), np.int64), np.ones(len(here), np.bool_)
        for step in range(1, self._config.steps):
            following = after[last] % self._size
            goes_on &= after[following] != NOWHERE
            rewards = np.where(goes_on, rewards + np.float32(self._gamma**step) * reward[following], rewards)
            steps += goes_on
            last = np.where(goes_on, following, last)
        return last, rewards, steps

    def _seen(self, positions: IntArray) -> dict[str, Tensor]:
        """Observations at (B,) positions; pictures with the frames before them, as far as the window reaches."""
        slots = positions % self._size
        stacks = [positions]
        for _ in range(1, self._stack):
            before = self._arrays["before"][stacks[0] % self._size]
            stacks.insert(0, np.where(before >= self._start, before, stacks[0]))
        observation = {}
        for name, column in self._columns.items():
            if not name.startswith("observation."):
                continue
            if self._stack > 1 and column.ndim == 4:
                frames = _taken(column, np.stack(stacks, axis=1).reshape(-1) % self._size)
                seen = frames.reshape(len(positions), -1, *column.shape[2:])
            else:
                seen = _taken(column, slots)
            observation[name.removeprefix("observation.")] = seen
        return observation

    # Checkpoints

    def state(self) -> dict[str, Any]:
        """State for `restore`, after all running episodes were cut; writes the memory map to the disk."""
        if self._columns:
            _flush(self._folder)
        self._protected.append(self._start)
        weights = [torch.from_numpy(tree.weights(self._window())) for tree in self._trees.values()]
        return {
            "head": self._head,
            "protected": list(self._protected),
            "generator": self._generator.get_state(),
            # A transition is in the tree of its source alone.
            "weights": torch.stack(weights).sum(dim=0) if self._config.priority and weights else None,
            "top_priority": self._top_priority,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state, whose entries are in the folder.

        Raises:
            InvalidInputError: They are not.
        """
        self._head, self._top_priority = state["head"], state["top_priority"]
        self._protected = deque(state["protected"], maxlen=KEPT)
        self._generator.set_state(state["generator"])
        if not self._head:
            return
        try:
            self._use(TensorDict.load_memmap(self._folder))
        except (OSError, ValueError, RuntimeError) as error:
            raise InvalidInputError(f"no replay of the checkpoint in '{self._folder}': {error}") from error
        window = self._window()
        weights = np.ones(len(window)) if state["weights"] is None else state["weights"].numpy()
        acted, sources = self._arrays["after"][window] != NOWHERE, self._arrays["source"][window]
        for source in np.unique(sources[acted]).tolist():
            chosen = acted & (sources == source)
            self._tree(source).set(window[chosen], weights[chosen])

    def _window(self) -> IntArray:
        """Slots of the window, oldest first."""
        return np.arange(self._start, self._head) % self._size


def _blank(observations: Dict, actions: Space[Any], stack: int, extras: Mapping[str, Tensor]) -> TensorDict:
    """Entry of zeros."""
    frames = {
        f"observation.{name}": torch.zeros(1, *(space.shape or ()), dtype=_dtype(space))
        for name, space in observations.items()
    }
    columns = {name: _newest(frame, stack)[0] for name, frame in frames.items()}
    columns |= {"action": torch.zeros(actions.shape or (), dtype=_dtype(actions)), **extras}
    columns |= {"reward": torch.tensor(0.0), "source": torch.tensor(0, dtype=torch.uint8)}
    columns |= dict.fromkeys(("terminated", "truncated"), torch.tensor(False))
    return TensorDict(columns | dict.fromkeys(("row", "episode", "before", "after"), torch.tensor(0)), [])


def _dtype(space: Space[Any]) -> torch.dtype:
    return torch.from_numpy(np.zeros(1, space.dtype)).dtype


def _newest(stack: Any, frames: int) -> Any:
    """(B, k C, H, W) stacks of k pictures -> (B, C, H, W) the last ones; vectors as they are."""
    return stack[:, stack.shape[1] // frames * (frames - 1) :] if stack.ndim == 4 else stack


def _taken(column: Tensor, slots: IntArray) -> Tensor:
    return column.index_select(0, torch.from_numpy(slots))


def _flush(folder: Path) -> None:
    """Writes the dirty pages of all files of a folder to the disk."""
    for path in folder.rglob("*.memmap"):
        with path.open("rb") as file:
            os.fsync(file.fileno())


def _stream(seed: int) -> int:
    """Seed of the batches. With the run's own they would be drawn by the numbers that weights and noise are."""
    return int(np.random.SeedSequence([_BATCHES, seed]).generate_state(1)[0])
