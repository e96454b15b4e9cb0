"""Tables of N lots with up to K karts: what stands in them, and how their episodes go.

The walls of all lots are rows of one table, and so are boxes, spots, pedestrians and karts: row `lot * capacity +
index`. So few arrays go from kernel to kernel, and none is sliced: numba counts references of both.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.contact import STORED
from dohyo.sumo_networks.parking.limits import MAX_BOXES, MAX_PEDESTRIANS, MAX_SPOTS, MAX_WALLS
from dohyo.sumo_networks.parking.rules import WIDTH, Outcome

KIND: Final = STORED
"""Column of a box after those of a stored box: the kind that the radar reports."""
FREE: Final = STORED
"""Column of a spot after those of a stored box: 1 if nothing stands in the spot, else 0."""
WALK_SPEED, WALK_RADIUS, WALKED, WALK_X, WALK_Y, WAITED = 4, 5, 6, 7, 8, 9
"""Columns of a pedestrian after the two points: speed [m/s], radius of the disc, way so far, present place [m], and the
time for which it has waited [s]."""
WALLS, BOXES, SPOTS, WALKERS, LIMIT, TICK = range(6)
"""Columns of a lot: number of its walls, boxes, spots and pedestrians; time limit and time so far, in ticks."""
OUTCOME, TARGET, HELD, TOUCHED, SHUNTS, GEAR, ENDED = range(7)
"""Columns of a kart's counts: `Outcome`; index of its target spot; substeps in place without a break; kind of what it
has touched, 0: nothing; changes between forwards and backwards; direction of the last motion (1, -1, 0: none yet); tick
in which its episode ended."""


class Tables(NamedTuple):
    """Everything that kernels read and write.

    Attributes:
        walls: (N * 16, 4) both ends, m.
        boxes: (N * 32, 9) blocks and parked cars: stored box, `KIND`.
        spots: (N * 24, 9) stored box, `FREE`.
        walkers: (N * 8, 10) pedestrians: two points [m], `WALK_SPEED` to `WAITED`.
        lots: (N, 6) `WALLS` to `TICK`.
        rules: (N, 10) `Rules.row`.
        karts: (N * K, 10) states, see `dohyo.sumo_networks.parking.kart`.
        counts: (N * K, 7) `OUTCOME` to `ENDED`.
    """

    walls: FloatArray
    boxes: FloatArray
    spots: FloatArray
    walkers: FloatArray
    lots: IntArray
    rules: FloatArray
    karts: FloatArray
    counts: IntArray

    @classmethod
    def empty(cls, lots: int, karts: int) -> Tables:
        """N empty lots whose episodes have not begun."""
        counts = np.zeros((lots * karts, 7), np.int64)
        counts[:, OUTCOME] = Outcome.ABSENT
        return cls(
            walls=np.zeros((lots * MAX_WALLS, 4)),
            boxes=np.zeros((lots * MAX_BOXES, STORED + 1)),
            spots=np.zeros((lots * MAX_SPOTS, STORED + 1)),
            walkers=np.zeros((lots * MAX_PEDESTRIANS, 10)),
            lots=np.zeros((lots, 6), np.int64),
            rules=np.zeros((lots, WIDTH)),
            karts=np.zeros((lots * karts, kart.STATE)),
            counts=counts,
        )
