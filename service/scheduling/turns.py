"""Turns: fair order between owners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from dohyo.service.scheduling.queue import Waiting


@dataclass(slots=True)
class Turns:
    """Time of the last service by owner."""

    count: int = 0
    last: dict[str, int] = field(default_factory=dict)

    def next(self, candidates: Sequence[Waiting]) -> Waiting:
        """The oldest evaluation of the owner who was served longest ago."""
        chosen = min(candidates, key=lambda one: self.last.get(one.owner, 0))  # the first of equals is the oldest
        self.count += 1
        self.last[chosen.owner] = self.count
        return chosen
