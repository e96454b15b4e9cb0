"""Infractions per kilometre, pooled over drives."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable

from dohyo.evaluation.records.record import EgoRecord
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.scores.driving import MIN_KM, route_km


def infraction_counts(ego: EgoRecord) -> dict[InfractionKind, int]:
    """Number of infractions of every kind, zeros included; an OUTSIDE_LANES event of any length counts one."""
    counts = Counter(one.kind for one in ego.infractions)
    return {kind: counts[kind] for kind in InfractionKind}


def infractions_per_km(egos: Iterable[EgoRecord]) -> dict[InfractionKind, float]:
    """Infractions of every kind per kilometre of route completed, pooled.

    sum of counts / max(0.001 km, sum of route length * RC). Rates are pooled, so that a drive that ended after a metre
    has the weight of a metre. Source: CARLA Leaderboard 2.0 (1.0 averaged the rates of the routes).
    """
    egos = list(egos)
    km = max(MIN_KM, math.fsum(route_km(ego) for ego in egos))
    total = Counter(one.kind for ego in egos for one in ego.infractions)
    return {kind: total[kind] / km for kind in InfractionKind}
