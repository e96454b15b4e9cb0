"""Explanations of an episode: a file of JSON lines, which a confined process writes and the service reads."""

from __future__ import annotations

import gzip
import json
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from dohyo.evaluation.agent import Explanation
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

EXPLANATIONS_LIMIT_BYTES: Final = 100_000_000
LEVEL: Final = 4
TRACE: Final = "explanations.jsonl.gz"


@dataclass(slots=True)
class Trace:
    """Explanations as JSON lines: line t holds those of the decisions taken at tick t, by ego.

    Attributes:
        lines: Lines by ego, one per decision, encoded at once, since agents may change the object later.
        size: Size in bytes; beyond the limit, explanations are replaced by null.
    """

    lines: dict[str, list[str]] = field(default_factory=dict)
    size: int = 0

    def noter(self, ego: str) -> Callable[[Explanation | None], None]:
        """Receiver of one ego's explanations."""
        lines = self.lines.setdefault(ego, [])

        def note(explanation: Explanation | None) -> None:
            text = "null" if self.size > EXPLANATIONS_LIMIT_BYTES else encoded(explanation)
            self.size += len(text)
            lines.append(text)

        return note

    def write(self, path: Path) -> None:
        """Writes all ticks as gzip, complete or not at all."""
        ticks = max(map(len, self.lines.values()), default=0)
        table = []
        for tick in range(ticks):
            known = ((ego, lines[tick]) for ego, lines in self.lines.items() if tick < len(lines))
            table.append("{" + ",".join(f"{json.dumps(ego)}:{text}" for ego, text in known) + "}")
        write_atomically(path, gzip.compress("\n".join(table).encode(), LEVEL, mtime=0))


def explanation_at(path: Path, tick: int) -> dict[str, Any]:
    """The explanations of one tick by ego; empty after the last decision. What follows them is not unpacked.

    Raises:
        InvalidInputError: If the file is missing or damaged.
    """
    try:
        with gzip.open(path) as lines:
            line = next(islice(lines, tick, None), b"")
        found: dict[str, Any] = json.loads(line.strip() or b"{}")
    except (OSError, EOFError, ValueError, RecursionError, zlib.error) as error:
        raise InvalidInputError(f"{path.name}: expected explanations as JSON lines, gzip'd: {error}") from error
    return found


def encoded(explanation: Explanation | None) -> str:
    """JSON on one line, null for NaN and infinity; an explanation that cannot be encoded must not end the drive."""
    try:
        return msgspec.json.encode(explanation, enc_hook=_plain).decode()
    except (TypeError, ValueError, RecursionError) as error:
        return json.dumps({"unreadable": f"{type(error).__name__}: {error}"})


def _plain(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)
