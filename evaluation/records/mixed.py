"""Mixed records: episodes whose egos had different agents, agent by agent."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain

from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord
from dohyo.evaluation.records.specifications import Status


class AgentDrives(EpisodeRecord):
    """The drives of one agent in an episode of several; it is never written, since its hash is that of the whole.

    Attributes:
        episode_fault: The infrastructure fault of any ego of the episode.
    """

    episode_fault: Status | None

    @property
    def fault(self) -> Status | None:
        """The infrastructure fault for which the whole episode is lost; None: it is not lost."""
        return self.episode_fault


def agents_of(records: Iterable[EpisodeRecord]) -> list[AgentInfo]:
    """Every agent that drove, once, in the order of its first drive."""
    found: list[AgentInfo] = []
    for ego in chain.from_iterable(record.egos for record in records):
        if ego.agent not in found:
            found.append(ego.agent)
    return found


def drives_of(agent: AgentInfo, record: EpisodeRecord) -> EpisodeRecord | None:
    """A record with the drives of one agent only; None if it drove no ego."""
    egos = tuple(ego for ego in record.egos if ego.agent == agent)
    if len(egos) in (0, len(record.egos)):
        return record if egos else None
    fields = {name: getattr(record, name) for name in EpisodeRecord.model_fields}
    return AgentDrives.model_construct(**fields | {"egos": egos}, episode_fault=record.fault)
