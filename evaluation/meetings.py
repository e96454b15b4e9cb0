"""Meetings: which agents drove in the same episodes, and how often their egos collided."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

from dohyo.evaluation.records.mixed import agents_of
from dohyo.evaluation.records.record import EgoRecord, EpisodeRecord
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
    episodes: Counter[tuple[int, int]] = Counter()
    collisions: Counter[tuple[int, int]] = Counter()
    for record in records:
        if record.lost:
            continue
        driven = {ego.name: agents.index(ego.agent) for ego in record.egos}
        episodes.update(combinations(sorted(set(driven.values())), 2))
        for ego in record.egos:
            for other in _hit(ego, driven):
                collisions[min(driven[ego.name], other), max(driven[ego.name], other)] += 1
    return [Meeting(*pair, count, collisions[pair]) for pair, count in sorted(episodes.items())]


def _hit(ego: EgoRecord, driven: dict[str, int]) -> list[int]:
    """Agents of the egos that an ego collided with."""
    hits = (one.actor for one in ego.infractions if one.kind in COLLISIONS)
    return [driven[actor] for actor in hits if actor in driven]
