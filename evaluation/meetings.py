"""Meetings: which agents drove in the same episodes, and how often their egos collided."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations

from dohyo.evaluation.records.mixed import agents_of
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import COLLISIONS


@dataclass(frozen=True, slots=True)
class Meeting:
    """Two agents that met.

    Attributes:
        agent: Position of an agent in `agents_of` the records.
        other: Position of the other one.
        episodes: Number of episodes with egos of both.
        collisions: Number of collisions that an ego of one had with an ego of the other.
    """

    agent: int
    other: int
    episodes: int
    collisions: int


def meetings(records: Iterable[EpisodeRecord]) -> list[Meeting]:
    """Every pair of agents with a common episode; lost episodes are left out.

    A collision of two egos is in the record of each of them that moved, so it may count twice.
    """
    records = list(records)
    agents = agents_of(records)
    return count_meetings(
        ({ego.name: agents.index(ego.agent) for ego in record.egos}, hits_of(record))
        for record in records
        if not record.lost
    )


def count_meetings(episodes: Iterable[tuple[Mapping[str, int], Mapping[str, Mapping[str, int]]]]) -> list[Meeting]:
    """The same from episodes: the position of each ego's agent, and the egos that each ego hit, see `hits_of`."""
    common: Counter[tuple[int, int]] = Counter()
    collisions: Counter[tuple[int, int]] = Counter()
    for driven, hits in episodes:
        common.update(combinations(sorted(set(driven.values())), 2))
        for ego, hit in hits.items():
            for other, count in hit.items():
                collisions[min(driven[ego], driven[other]), max(driven[ego], driven[other])] += count
    return [Meeting(*pair, count, collisions[pair]) for pair, count in sorted(common.items())]


def hits_of(record: EpisodeRecord) -> dict[str, Counter[str]]:
    """Number of collisions that each ego had with each other ego of its episode, where there were any."""
    names = {ego.name for ego in record.egos}
    found: dict[str, Counter[str]] = {}
    for ego in record.egos:
        for one in ego.infractions:
            if one.kind in COLLISIONS and one.actor is not None and one.actor in names:
                found.setdefault(ego.name, Counter())[one.actor] += 1
    return found
