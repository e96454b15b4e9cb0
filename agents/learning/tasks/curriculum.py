"""Curriculum: levels of difficulty, and the rule by which a learner is promoted to the next one."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dohyo.sumo_networks.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Curriculum:
    """Levels 0 to `levels` - 1; held-out episodes are of the last level.

    Attributes:
        levels: Number of levels.
        threshold: Success rate of the policy's last episodes at which it is promoted.
        window: Number of these episodes, all begun at the present level, in the order in which they began.
    """

    levels: int
    threshold: float = 0.8
    window: int = 100

    def __post_init__(self) -> None:
        """Raises InvalidInputError for a curriculum without levels, episodes, or a threshold in (0, 1]."""
        if self.levels < 1 or self.window < 1 or not 0.0 < self.threshold <= 1.0:
            raise InvalidInputError(f"expected levels and window of at least 1 and a threshold in (0, 1], got {self}")

    def wanted(self, first: float) -> float:
        """Success rate that promotes, from that of the level's first window."""
        return self.threshold


@dataclass(slots=True)
class _Begun:
    """An episode: whether it is over, and whether it succeeded; None: it counts for nothing."""

    over: bool = False
    success: bool | None = None


class Progress:
    """A learner's way through a curriculum.

    Episodes count in the order in which they began, each when all before it are over: in the order of their ends the
    short ones would come first, and a level would be judged by them. At a cut, episodes that run, and those begun after
    the first of them, count for nothing, neither as success nor as failure: else of the last ones before a cut the
    short ones alone would count.

    Attributes:
        level: Of the episodes that begin now.
    """

    def __init__(self, curriculum: Curriculum | None) -> None:
        """Begins at level 0."""
        self._curriculum, self.level = curriculum or Curriculum(1), 0
        self._successes: deque[bool] = deque(maxlen=self._curriculum.window)
        self._first: float | None = None  # success rate of the level's first window
        self._waiting: deque[_Begun] = deque()  # episodes that do not count yet, in the order of their beginnings
        self._running: dict[int, _Begun] = {}  # by row

    def begin(self, row: int) -> None:
        """An episode begins at the present level in a row in which none runs."""
        if self.level + 1 < self._curriculum.levels:
            self._running[row] = one = _Begun()
            self._waiting.append(one)

    def end(self, row: int, success: bool | None) -> None:
        """The episode of a row is over; promotes when enough of the last ones succeeded.

        Args:
            row: Of the episode; without effect if none runs there, or it began at a level before.
            success: Whether the policy succeeded; None: the episode counts for nothing.
        """
        one = self._running.pop(row, None)
        if one is None:
            return
        one.over, one.success = True, success
        while self._waiting and self._waiting[0].over:
            counted = self._waiting.popleft().success
            if counted is not None:
                self._count(counted)

    def cut(self) -> None:
        """All running episodes are forgotten; see the class."""
        self._waiting.clear()
        self._running.clear()

    def _count(self, success: bool) -> None:
        self._successes.append(success)
        rule, count = self._curriculum, len(self._successes)
        if count < rule.window:
            return
        rate = sum(self._successes) / count
        self._first = rate if self._first is None else self._first
        if rate >= rule.wanted(self._first):
            self.level, self._first = self.level + 1, None
            self._successes.clear()
            self.cut()

    def state(self) -> dict[str, Any]:
        """State for `restore`, after a cut."""
        return {"level": self.level, "successes": list(self._successes), "first": self._first}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""
        self.level = state["level"]
        self._successes = deque(state["successes"], self._curriculum.window)
        self._first = state["first"]
        self.cut()
