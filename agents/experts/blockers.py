"""Blockers: obstacles that stay in the ego's lane, as opposed to a queue that will move on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dohyo.agents.planning.surroundings import Neighbour, Surroundings
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.world import ActorKind

SIGHT_M = 55.0
LINK_M = 15.0
CHAIN_M = 60.0
QUEUE_M = 25.0
OPEN_M = 50.0
CLOSE_M = 30.0
PARKED_S = 45.0
ALONE_S = 4.0
BROKEN_DOWN_S = 60.0
BICYCLE_M_S = 5.0
ASKEW = 0.997
OVERHANG_M = 2.0


@dataclass(frozen=True, slots=True)
class Blocker:
    """Obstacle that the ego has to pass, in the frame of the route.

    Attributes:
        first: Rear end along the route, m.
        last: Front end along the route, m.
        d_low: Right edge, m.
        d_high: Left edge, m.
        speed: m/s; above 0 for bicycles.
    """

    first: float
    last: float
    d_low: float
    d_high: float
    speed: float


class Patience:
    """Standing time of every actor, and which actors have been seen driving."""

    def __init__(self) -> None:
        self._stood: dict[int, float] = {}
        self._driven: set[int] = set()

    def watch(self, neighbours: Sequence[Neighbour], seconds: float = 0.1) -> None:
        """Updates by one tick."""
        self._stood = {one.key: self._stood.get(one.key, 0.0) + seconds for one in neighbours if one.stands}
        self._driven |= {one.key for one in neighbours if one.speed > 1.0}

    def parked(self, one: Neighbour) -> bool:
        """Whether an actor was never seen driving."""
        return one.key not in self._driven

    def obstructs(self, one: Neighbour) -> bool:
        """Whether an actor is no traffic: a thing, or a vehicle that was never seen driving and stands askew."""
        return one.kind == ActorKind.STATIC or (self.parked(one) and abs(one.along) < ASKEW)

    def stands_for_good(self, one: Neighbour, alone: bool) -> bool:
        """Whether an actor has stood too long to wait for it. One that stands askew has crashed.

        Args:
            one: The standing actor.
            alone: Whether the road ahead of it is open, so that it is not in a queue.
        """
        if self.obstructs(one):
            return True
        least = (ALONE_S if alone else PARKED_S) if self.parked(one) else BROKEN_DOWN_S
        return self._stood.get(one.key, 0.0) >= least


def find_blocker(
    around: Surroundings, junctions: Float32Array, patience: Patience, reach: float, behind: float, front: float
) -> tuple[Blocker | None, bool]:
    """Blocker in the ego's lane ahead, and whether to pass it now: it may still be a queue.

    Args:
        around: Actors and lanes.
        junctions: (4, 4), see `sensors.junctions_ahead`.
        patience: Standing times.
        reach: Half the width of the corridor that the ego needs, m.
        behind: Actors that end before this are past, m from the ego's centre.
        front: Of the ego, from which junctions are measured, m from its centre.
    """
    ahead = [one for one in around.driving() if one.within(-reach, reach) and behind < one.s_high and not one.oncoming]
    chain: list[Neighbour] = []
    for one in sorted(ahead, key=lambda one: one.s_low):
        crawls = one.stands or (one.kind == ActorKind.BICYCLE and one.speed < BICYCLE_M_S and one.along > 0.9)
        if not crawls or one.s_low > (chain[-1].s_high + LINK_M if chain else SIGHT_M):
            break
        chain.append(one)
    if not chain:
        return None, False
    last = max(one.s_high for one in chain)
    blocker = Blocker(
        chain[0].s_low,
        last,
        min(one.d_low for one in chain),
        max(one.d_high for one in chain),
        0.0 if any(one.stands for one in chain) else max(one.speed for one in chain),
    )
    static = any(one.kind == ActorKind.STATIC for one in chain)
    no_queue = static or patience.obstructs(chain[-1])
    if (last - chain[0].s_low > CHAIN_M and not no_queue) or _at_a_junction(last - front, junctions, no_queue):
        return None, False
    alone = _open_road(ahead, junctions, chain, last, last - front)
    return blocker, static or blocker.speed > 0.0 or patience.stands_for_good(chain[-1], alone)


def _open_road(
    ahead: Sequence[Neighbour], junctions: Float32Array, chain: Sequence[Neighbour], last: float, end: float
) -> bool:
    """Whether neither a junction nor a vehicle ahead of the last one explains that it waits."""
    queued = any(last < one.s_low < last + CLOSE_M for one in ahead if one not in chain)
    return not queued and not any(entry < end + OPEN_M and leave - entry > 1.0 for entry, leave, _, _ in junctions)


def _at_a_junction(end: float, junctions: Float32Array, no_queue: bool) -> bool:
    """Whether a junction lies before a blocker's end [m from the front], or so close ahead of it that it may queue."""
    for entry, leave, _, _ in junctions:
        # A junction of two roads only is a continuation, no junction.
        if entry >= 1000.0 or leave - entry <= 1.0:
            continue
        if leave > 0.0 and entry < end + (0.0 if no_queue else QUEUE_M) - OVERHANG_M:
            return True
    return False
