"""Allowances: the speed that each kind of obstacle allows, and the distance at which to stop.

Crossing actors and lights are also in the state row by row. Here is the minimum of each kind, so that a policy treats
all rows alike.
"""

from __future__ import annotations

import math

import numpy as np

from dohyo.agents.hierarchical.environments.pace import (
    LINE_GAP_M,
    YIELD_GAP_M,
    closed,
    coming,
    following_speed,
    stopping_speed,
)
from dohyo.agents.hierarchical.state.nearby import EVENT_M, IMPACT_M, SPEED_UNIT_M_S
from dohyo.sumo_networks.arrays import BoolArray, Float32Array
from dohyo.sumo_networks.world import ActorKind

ALLOWANCES = 9


def allowances(strips: Float32Array, junctions: Float32Array, conflicts: Float32Array) -> Float32Array:
    """(9,) speeds [15 m/s, at most 1] and roots of distances [50 m, at most 1]; 1 without a restriction.

    In this order: speed behind the first body ahead; speed and distance of the first line that is closed; the same of
    the first crossing pedestrian, of traffic with the right of way, and where neither has it.

    Args:
        strips: (3, 5), see `nearby.strips`.
        junctions: (4, 4), see `sensors.junctions_ahead`.
        conflicts: (16, 8), see `sensors.conflicts`.
    """
    free, gap = float(strips[0, 1]) >= 1.0, float(strips[0, 1]) ** 2 * IMPACT_M
    leader = 1.0 if free else following_speed(gap, float(strips[0, 2]) * SPEED_UNIT_M_S) / SPEED_UNIT_M_S
    out = [min(leader, 1.0), *_stand(junctions[closed(junctions), 0], LINE_GAP_M)]
    enter, priority, kind = conflicts[:, (0, 5, 6)].T
    comes = coming(conflicts)
    on_foot: BoolArray = kind == ActorKind.PEDESTRIAN
    for some in (on_foot, ~on_foot & (priority > 0.0), ~on_foot & (priority == 0.0)):
        out += _stand(enter[comes & some], YIELD_GAP_M)
    return np.array(out, dtype=np.float32)


def _stand(distances: Float32Array, gap: float) -> tuple[float, float]:
    """Speed and distance of the nearest stopping place."""
    nearest = float(distances.min()) if len(distances) else EVENT_M
    if nearest >= EVENT_M:
        return 1.0, 1.0
    return min(stopping_speed(nearest, gap) / SPEED_UNIT_M_S, 1.0), math.sqrt(nearest / EVENT_M)
