"""Standings: leaderboards cached in memory, since finished evaluations never change."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from typing import Final, Generic, TypeVar

from sqlalchemy.orm import Session

from dohyo.service.boards import queries as reading
from dohyo.service.boards.leaderboard import Entry, Row, rank

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")

ENTRIES: Final = 500
LEADERBOARDS: Final = 100


@dataclass(slots=True)
class Recent(Generic[K, V]):
    """Cache of the `size` most recently used values."""

    size: int
    values: OrderedDict[K, V] = field(default_factory=OrderedDict)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def get(self, key: K) -> V | None:
        """The value, or None."""
        with self.lock:
            if key in self.values:
                self.values.move_to_end(key)
            return self.values.get(key)

    def put(self, key: K, value: V) -> None:
        """Stores a value and drops the least recently used one."""
        with self.lock:
            self.values[key] = value
            self.values.move_to_end(key)
            while len(self.values) > self.size:
                self.values.popitem(last=False)


class Standings:
    """Rows of leaderboards by the ranked evaluations and the score."""

    def __init__(self) -> None:
        self._entries: Recent[str, Entry] = Recent(ENTRIES)
        self._boards: Recent[tuple[tuple[str, ...], str], list[Row]] = Recent(LEADERBOARDS)
        self._building = threading.Lock()

    def rows(
        self, session: Session, benchmark_sha256: str, track: str | None, owner: str | None, metric: str
    ) -> list[Row]:
        """The current leaderboard; see `dohyo.service.boards.leaderboard.rank`."""
        ids = tuple(reading.ranked_evaluations(session, benchmark_sha256, track, owner))
        return self._cached(ids, metric, lambda: self._finished(session, ids))

    def _cached(self, ids: tuple[str, ...], metric: str, load: Callable[[], list[Entry]]) -> list[Row]:
        rows = self._boards.get((ids, metric))
        if rows is None:
            with self._building:  # one thread builds, the others wait for its result
                rows = self._boards.get((ids, metric))
                if rows is None:
                    rows = rank([entry for entry in load() if entry.drives and metric in entry.scores], metric)
                    self._boards.put((ids, metric), rows)
        return rows

    def _finished(self, session: Session, ids: Sequence[str]) -> list[Entry]:
        known = {one: self._entries.get(one) for one in ids}
        missing = [one for one, entry in known.items() if entry is None]
        for one, entry in reading.entries(session, missing).items() if missing else ():
            known[one] = entry
            self._entries.put(one, entry)
        return [entry for entry in known.values() if entry is not None]
