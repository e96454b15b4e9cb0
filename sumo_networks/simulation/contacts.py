"""Contacts: whose boxes touch an ego's. SUMO's own collision test knows only lanes."""

from __future__ import annotations

import numpy as np

from sumo_networks.arrays import BoolArray
from sumo_networks.geometry import boxes_overlap
from sumo_networks.world import ActorKind, Actors, Contact, Egos


def contacts(egos: Egos, actors: Actors) -> tuple[Contact, ...]:
    """Boxes that touch an active ego's."""
    boxes = np.column_stack([egos.position, egos.heading, egos.length, egos.width])
    found = []
    overlap = boxes_overlap(boxes, actors.boxes())
    if overlap.any():
        for ego, row in zip(*np.nonzero(overlap), strict=True):
            if egos.active[ego]:
                found.append(Contact(int(ego), int(actors.key[row]), ActorKind(actors.kind[row]), int(row)))
    if len(boxes) > 1:
        mutual: BoolArray = boxes_overlap(boxes, boxes)
        for a, b in zip(*np.nonzero(mutual), strict=True):
            if a != b and egos.active[a] and egos.active[b]:
                found.append(Contact(int(a), -1 - int(b), ActorKind.EGO, int(b)))
    return tuple(found)
