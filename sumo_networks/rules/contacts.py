"""Contacts: whose boxes touch an ego's. SUMO's own collision test knows only lanes."""

from __future__ import annotations

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.geometry import box_overlaps
from dohyo.sumo_networks.world import ActorKind, Actors, Contact, Egos, World


def contacts(egos: Egos, actors: Actors) -> tuple[Contact, ...]:
    """Boxes that touch an active ego's."""
    own = egos.active, egos.position, egos.heading, egos.length, egos.width
    found = [
        Contact(ego, int(actors.key[row]), ActorKind(actors.kind[row]), row)
        for ego, row in _touching(*own, actors.position, actors.heading, actors.length, actors.width).tolist()
    ]
    if len(egos.names) > 1:
        found += [
            Contact(a, -1 - b, ActorKind.EGO, b)
            for a, b in _touching(*own, egos.position, egos.heading, egos.length, egos.width).tolist()
            if a != b and egos.active[b]
        ]
    return tuple(found)


def is_touched(world: World, ego: int) -> bool:
    """Whether anything touches an ego."""
    return any(contact.ego == ego for contact in world.contacts)


@njit(cache=True)
def _touching(
    active: BoolArray,
    position: FloatArray,
    heading: FloatArray,
    length: FloatArray,
    width: FloatArray,
    other_position: FloatArray,
    other_heading: FloatArray,
    other_length: FloatArray,
    other_width: FloatArray,
) -> IntArray:
    """(K, 2) rows of the active ones of E boxes and of those of M others that they touch."""
    found = []
    box, other = np.empty(5), np.empty(5)
    for e in range(active.shape[0]):
        if not active[e]:
            continue
        box[0], box[1], box[2], box[3], box[4] = position[e, 0], position[e, 1], heading[e], length[e], width[e]
        for i in range(other_heading.shape[0]):
            other[0], other[1], other[2] = other_position[i, 0], other_position[i, 1], other_heading[i]
            other[3], other[4] = other_length[i], other_width[i]
            if box_overlaps(box, other):
                found.append((e, i))
    out = np.empty((len(found), 2), dtype=np.int64)
    for row in range(len(found)):
        out[row, 0], out[row, 1] = found[row]
    return out
