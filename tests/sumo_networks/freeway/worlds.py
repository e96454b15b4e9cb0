"""Hand-made worlds of the freeway: vehicles where a test wants them, without SUMO."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dohyo.sumo_networks.freeway.road import load_freeway
from dohyo.sumo_networks.freeway.world import FreewayWorld


def world_of(
    time_s: float,
    positions_m: Sequence[float],
    speeds_mps: Sequence[float],
    *,
    lanes: Sequence[int] | None = None,
    probes: Sequence[bool] | None = None,
    connected: Sequence[bool] | None = None,
    length_m: float = 5.0,
) -> FreewayWorld:
    """Vehicles `v0`, `v1`, ...; all in lane 0, probes and connected unless said otherwise."""
    number = len(positions_m)
    return FreewayWorld(
        road=load_freeway(),
        time_s=time_s,
        names=tuple(f"v{row}" for row in range(number)),
        position_m=np.array(positions_m, dtype=np.float64),
        lane=np.array(lanes if lanes is not None else [0] * number, dtype=np.int64),
        speed_mps=np.array(speeds_mps, dtype=np.float64),
        acceleration_mps2=np.zeros(number),
        length_m=np.full(number, length_m),
        connected=np.array(connected if connected is not None else [True] * number, dtype=np.bool_),
        probe=np.array(probes if probes is not None else [True] * number, dtype=np.bool_),
        vtype=np.zeros(number, dtype=np.int64),
        fuel_mg_s=np.full(number, 1000.0),
    )
