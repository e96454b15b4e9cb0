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
        window: Number of these episodes, all begun at the present level.
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


class Progress:
    """A learner's way through a curriculum.

    Attributes:
        level: Of the episodes that begin now.
    """

    def __init__(self, curriculum: Curriculum | None) -> None:
        """Begins at level 0."""
        self._curriculum, self.level = curriculum or Curriculum(1), 0
        self._successes: deque[bool] = deque(maxlen=self._curriculum.window)
        self._first: float | None = None  # success rate of the level's first window

    def add(self, level: int, success: bool) -> None:
        """Counts an episode of the policy; promotes when enough of the last ones succeeded."""
        if level != self.level:
            return
        self._successes.append(success)
        rule, count = self._curriculum, len(self._successes)
        if self.level + 1 == rule.levels or count < rule.window:
            return
        rate = sum(self._successes) / count
        self._first = rate if self._first is None else self._first
        if rate >= rule.wanted(self._first):
            self.level, self._first = self.level + 1, None
            self._successes.clear()

    def state(self) -> dict[str, Any]:
        """State for `restore`."""
        return {"level": self.level, "successes": list(self._successes), "first": self._first}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""
        self.level = state["level"]
        self._successes = deque(state["successes"], self._curriculum.window)
        self._first = state["first"]
