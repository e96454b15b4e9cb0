"""Measures of one drive: NoCrash's success and the lawful one, collisions by kind, and where in the lane it drove."""

from __future__ import annotations

from collections import Counter
from typing import Final

import numpy as np

from dohyo.agents.studies.rows import Row
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.evaluation.summary import score_drive

EDGES_M: Final = (0.0, 0.1, 0.2, 0.3, 0.5, 0.75, 1.0, 1.5, 2.5)
"""Bins of the distance beside the route; the last one has no upper bound."""
UNLAWFUL: Final = (InfractionKind.RED_LIGHT, InfractionKind.STOP_SIGN)
EGO_KEY: Final = -1


def measures(record: EpisodeRecord, trajectory: Trajectory) -> Row:
    """Success in %, infractions by kind, distances in m, ticks per bin of `EDGES_M`, milliseconds per decision."""
    ego = record.egos[0]
    scores, found = score_drive(ego), Counter(one.kind for one in ego.infractions)
    beside = np.abs(trajectory.lateral[trajectory.key == EGO_KEY])
    ticks = np.histogram(beside, bins=(*EDGES_M, np.inf))[0]
    success = scores["nocrash_success"] or 0.0
    return {
        "status": ego.status.value,
        "success": success,
        "lawful_success": 0.0 if any(found[kind] for kind in UNLAWFUL) else success,
        "route_completion": scores["route_completion"],
        "route_m": ego.route_length_m,
        "driven_m": ego.driven_m,
        "infractions": {kind.value: count for kind, count in found.items()},
        "lateral_ticks": ticks.tolist(),
        "decision_ms": record.timing.decision_ms[ego.name][0] if record.timing is not None else None,
    }
