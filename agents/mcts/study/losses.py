"""Points of the closed-loop score that a drive lost, by cause."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType

from dohyo.evaluation.records.record import EgoRecord
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.scores.nuplan.score import ClosedLoop

CAUSES: Mapping[str, str] = MappingProxyType(
    {
        "person": "hit somebody on foot, at fault",
        "no_collision": "hit a vehicle or an object, at fault",
        "drivable_area": "left the road",
        "driving_direction": "drove against its lane",
        "making_progress": "hardly moved",
        "time_to_collision": "time to collision below 0.95 s",
        "comfort": "comfort",
        "progress": "progress",
        "speed_limit": "speed limit",
    }
)
"""Those whose terms multiply the score come first, and the first of them takes all that a drive lost."""
_MULTIPLYING = ("no_collision", "drivable_area", "driving_direction", "making_progress")


def losses(terms: ClosedLoop, ego: EgoRecord) -> dict[str, float]:
    """Points lost by each of `CAUSES`; they add up to 100 less the score.

    Args:
        terms: Of the drive.
        ego: Record of the drive, with the collisions.
    """
    out = dict.fromkeys(CAUSES, 0.0)
    for term in _MULTIPLYING:
        if getattr(terms, term) < 1.0:
            on_foot = any(one.kind is InfractionKind.COLLISION_PEDESTRIAN and one.at_fault for one in ego.infractions)
            out["person" if term == "no_collision" and on_foot else term] = 100.0 - terms.score
            return out
    whole = {
        "time_to_collision": dataclasses.replace(terms, time_to_collision=1.0),
        "comfort": dataclasses.replace(terms, comfort=1.0),
        "progress": dataclasses.replace(terms, progress=1.0),
        "speed_limit": dataclasses.replace(terms, speed_limit=1.0),
    }
    return out | {term: without.score - terms.score for term, without in whole.items()}
