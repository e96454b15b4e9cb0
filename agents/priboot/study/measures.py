"""Measures of one drive: the scores of the thesis, and what they are made of, so that other lengths can be tried."""

from __future__ import annotations

from collections import Counter

from dohyo.agents.studies.rows import Row
from dohyo.evaluation.records.record import EgoRecord
from dohyo.evaluation.scores.driving import infraction_penalty, infraction_rate_score, outside_fraction
from dohyo.evaluation.summary import score_drive


def measures(ego: EgoRecord) -> Row:
    """Scores in %, the penalty in [0, 1], distances in m, and the number of infractions by kind."""
    scores = score_drive(ego)
    return {
        "status": ego.status.value,
        "driving_score": scores["driving_score"],
        "irs": infraction_rate_score(ego, length="driven"),
        "irs_route": infraction_rate_score(ego, length="route"),
        "route_completion": scores["route_completion"],
        "infraction_penalty": infraction_penalty(ego.infractions, "2.0", outside_fraction(ego)),
        "nocrash_success": scores["nocrash_success"],
        "route_m": ego.route_length_m,
        "driven_m": ego.driven_m,
        "duration_s": ego.duration_s,
        "infractions": dict(Counter(one.kind.value for one in ego.infractions)),
    }
