"""Drives a recorded episode again: compares the record and collects explanations. Runs in a confined process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dohyo.evaluation.agent import Agent, Explanation, Observation
from dohyo.evaluation.episode.guarded_agent import ACT_DEADLINE_S
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.parking.lot_files import is_lot, read_lot
from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.store import read_record
from dohyo.service.episodes.explanations import TRACE, Trace
from dohyo.service.episodes.recorded_agents import build_agents, check_known
from dohyo.sumo_networks.scenario import Mission


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


def drive_again(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Drives a record's episode once, in a confined process; see `kinds`.

    Args:
        arguments: `record`: path of the record.

    Returns:
        `expected`, `replayed`: hashes; `same`: whether they are equal. Then `TRACE` lies in the working directory, but
        for lots, whose agents explain nothing.
    """
    path = Path(arguments["record"])
    if is_lot(path):
        return _park_again(read_lot(path))
    record, trace = read_record(path), Trace()
    again = redrive(record, trace)
    same = again.record_hash == record.record_hash
    if same:
        trace.write(Path.cwd() / TRACE)
    return _compared(record.record_hash, again.record_hash)


def _park_again(record: ParkingRecord) -> dict[str, Any]:
    from dohyo.evaluation.parking.evaluate import drive_again  # loads numba

    check_known(record.agent)
    return _compared(record.record_hash, *drive_again([record]))


def _compared(expected: str, replayed: str) -> dict[str, Any]:
    return {"expected": expected, "replayed": replayed, "same": expected == replayed}
