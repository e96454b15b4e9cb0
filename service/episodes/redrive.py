"""Drives a recorded episode again: compares the record and collects explanations. Runs in a confined process."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from dohyo.evaluation.agent import Agent, Explanation, Observation
from dohyo.evaluation.episode.guarded_agent import ACT_DEADLINE_S
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.store import read_record
from dohyo.service.episodes.recorded_agents import build_agents
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.scenario import Mission

EXPLANATIONS_LIMIT_BYTES: Final = 100_000_000
LEVEL: Final = 4
TRACE: Final = "explanations.jsonl.gz"


class Explained(Agent):
    """Wraps an agent and passes its explanation to `note` after every decision; None without an explanation."""

    def __init__(self, agent: Agent, note: Callable[[Explanation | None], None]) -> None:
        self.agent, self.note, self.spec = agent, note, agent.spec

    def warm_up(self) -> None:
        """See `Agent`."""
        if hasattr(self.agent, "warm_up"):
            self.agent.warm_up()

    def reset(self, mission: Mission, seed: int) -> None:
        """See `Agent`."""
        self.agent.reset(mission, seed)

    def act(self, observation: Observation) -> np.ndarray:
        """The agent's decision."""
        action = self.agent.act(observation)
        self.note(self.agent.explain() if hasattr(self.agent, "explain") else None)
        return action

    def close(self) -> None:
        """See `Agent`."""
        self.agent.close()


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
            text = "null" if self.size > EXPLANATIONS_LIMIT_BYTES else _encoded(explanation)
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


def redrive(record: EpisodeRecord, trace: Trace) -> EpisodeRecord:
    """Drives a record's scenario again with the agents it names.

    Raises:
        InvalidInputError: The versions or an agent differ from the record's, or it names code that is not registered.
    """
    agents = {name: Explained(agent, trace.noter(name)) for name, agent in build_agents(record).items()}
    try:
        return drive_episode(
            record.scenario,
            agents,
            infos={ego.name: ego.agent for ego in record.egos},
            benchmark=record.benchmark,
            act_deadline_s=ACT_DEADLINE_S,
        )[0]
    finally:
        for agent in agents.values():
            agent.close()


def explanation_at(path: Path, tick: int) -> dict[str, Any]:
    """The explanations of one tick by ego; empty after the last decision.

    Raises:
        InvalidInputError: If the file is missing or damaged.
    """
    try:
        lines = gzip.decompress(path.read_bytes()).split(b"\n")
        found: dict[str, Any] = json.loads(lines[tick] or b"{}") if tick < len(lines) else {}
    except (OSError, EOFError, ValueError) as error:
        raise InvalidInputError(f"{path.name}: expected explanations as JSON lines, gzip'd: {error}") from error
    return found


def _encoded(explanation: Explanation | None) -> str:
    """JSON on one line, null for NaN and infinity; an explanation that cannot be encoded must not end the drive."""
    try:
        return msgspec.json.encode(explanation, enc_hook=_plain).decode()
    except (TypeError, ValueError, RecursionError) as error:
        return json.dumps({"unreadable": f"{type(error).__name__}: {error}"})


def _plain(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


def drive_again(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Drives a record's episode once, in a confined process; see `kinds`.

    Args:
        arguments: `record`: path of the record.

    Returns:
        `expected`, `replayed`: hashes; `same`: whether they are equal. Then `TRACE` lies in the working directory.
    """
    record, trace = read_record(Path(arguments["record"])), Trace()
    again = redrive(record, trace)
    same = again.record_hash == record.record_hash
    if same:
        trace.write(Path.cwd() / TRACE)
    return {"expected": record.record_hash, "replayed": again.record_hash, "same": same}
