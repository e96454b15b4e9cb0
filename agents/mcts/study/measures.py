"""Measures of one drive of a study: of an excerpt the closed-loop score, of a route what its benchmark counts."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from dohyo.agents.mcts.study.losses import losses
from dohyo.agents.studies.rows import Row
from dohyo.evaluation.records.record import EgoRecord
from dohyo.evaluation.records.specifications import COLLISIONS, Status
from dohyo.evaluation.scores.nuplan.score import ClosedLoop
from dohyo.evaluation.summary import score_drive

EXCERPTS: Final[Mapping[str, str]] = MappingProxyType(
    {"score": "score", "collisions": "CR, %", "off_road": "DA, %", "progress": "EP, %"}
)
"""Measures of drives that end after a time, and their heads."""
ROUTES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "nocrash_success": "NoCrash success, %",
        "driving_score": "DS",
        "route_completion": "RC, %",
        "perfect": "perfect, %",
        "hits": "hit somebody, %",
        "collisions": "at fault, %",
        "out_of_time": "out of time, %",
    }
)
"""Measures of drives that end at the goal."""
SHARES: Final = ("collisions", "off_road", "nocrash_success", "perfect", "hits", "out_of_time")
"""Measures that are 0 or 100 in every drive."""


def of_excerpt(terms: ClosedLoop, ego: EgoRecord) -> Row:
    """Measures of an excerpt; "points" are those that each cause took."""
    return {
        "score": terms.score,
        "collisions": 100.0 * (terms.no_collision < 1.0),
        "off_road": 100.0 * (terms.drivable_area < 1.0),
        "progress": 100.0 * terms.progress,
        "points": losses(terms, ego),
    }


def of_route(ego: EgoRecord) -> Row:
    """Measures of a whole route."""
    scores, hits = score_drive(ego), [one for one in ego.infractions if one.kind in COLLISIONS]
    return {
        **{name: scores[name] for name in ("nocrash_success", "driving_score", "route_completion")},
        "perfect": 100.0 * (ego.status is Status.PERFECT),
        "hits": 100.0 * bool(hits),
        "collisions": 100.0 * any(one.at_fault for one in hits),
        "out_of_time": 100.0 * (ego.status is Status.TIMED_OUT),
    }
