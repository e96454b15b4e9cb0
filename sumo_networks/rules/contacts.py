"""Contacts: actors whose boxes touch the box of an ego. SUMO's own collision test considers lanes only."""

from __future__ import annotations

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.geometry import box_overlaps
from dohyo.sumo_networks.objects import BoxColumns
from dohyo.sumo_networks.world import ActorKind, Actors, Contact, Egos, World


def contacts(egos: Egos, actors: Actors) -> tuple[Contact, ...]:
    """Contacts of all active egos with actors and other egos."""
    own = egos.columns()
    found = [
        Contact(ego, int(actors.key[row]), ActorKind(actors.kind[row]), row)
        for ego, row in _touching(egos.active, own, actors.columns()).tolist()
    ]
    if len(egos.names) > 1:
        found += [
            Contact(a, -1 - b, ActorKind.EGO, b)
            for a, b in _touching(egos.active, own, own).tolist()
            if a != b and egos.active[b]
        ]
    return tuple(found)


def is_touched(world: World, ego: int) -> bool:
    """Whether anything touches an ego."""
    return any(contact.ego == ego for contact in world.contacts)


@njit(cache=True)
def _copy_box(boxes: BoxColumns, row: int, out: FloatArray) -> None:
    """Writes one box into (5,)."""
    position, heading, _, length, width = boxes
    out[0], out[1], out[2] = position[row, 0], position[row, 1], heading[row]
    out[3], out[4] = length[row], width[row]


@njit(cache=True)
def _touching(active: BoolArray, own: BoxColumns, other: BoxColumns) -> IntArray:
    """(K, 2) pairs of rows: an active one of E boxes, and one of M other boxes that touches it."""
    found = []
    box, another = np.empty(5), np.empty(5)
    count = other[1].shape[0]
    for e in range(active.shape[0]):
        if not active[e]:
            continue
        _copy_box(own, e, box)
        for i in range(count):
            _copy_box(other, i, another)
            if box_overlaps(box, another):
                found.append((e, i))
    out = np.empty((len(found), 2), dtype=np.int64)
    for row in range(len(found)):
        out[row, 0], out[row, 1] = found[row]
    return out
