"""ParkingWorld: N lots in one process, which advance together by one tick of 0.1 s."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import BoolArray, Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.geometry import wrap_angle
from dohyo.sumo_networks.parking import kart, kernel
from dohyo.sumo_networks.parking.generate import Scene, draw
from dohyo.sumo_networks.parking.limits import MAX_BOXES, MAX_KARTS, MAX_PEDESTRIANS, MAX_SPOTS, MAX_WALLS, most_karts
from dohyo.sumo_networks.parking.lot import Lot
from dohyo.sumo_networks.parking.observation import COLUMNS, observe
from dohyo.sumo_networks.parking.rows import LotView, describe, write_lot
from dohyo.sumo_networks.parking.rules import (
    ALIGNED_ANGLE_RAD,
    ALIGNED_DEVIATION_M,
    JUDGED,
    Outcome,
    Rules,
)
from dohyo.sumo_networks.parking.tables import (
    BOXES,
    ENDED,
    LIMIT,
    OUTCOME,
    SHUNTS,
    SPOTS,
    TARGET,
    TOUCHED,
    WALKERS,
    WALLS,
    Tables,
)


@dataclass(frozen=True, slots=True)
class Results:
    """How the karts of some lots stand, arrays (R, K).

    Attributes:
        outcome: `Outcome`.
        success: Whether the kart is parked.
        aligned: Whether it is parked within 3 degrees and 0.2 m (ISO 16787).
        time_s: Time until the end of the kart's episode.
        inclination_rad: Angle between the axes of kart and spot; spots may be entered backwards.
        deviation_m: Distance of the kart's centre to the spot's axis.
        distance_m: Distance of the kart's centre to the spot's centre.
        driven_m: Distance driven.
        shunts: Changes between forwards and backwards.
        touched: Kind of what the kart has touched; `Kind.NOTHING`: nothing.
    """

    outcome: IntArray
    success: BoolArray
    aligned: BoolArray
    time_s: FloatArray
    inclination_rad: FloatArray
    deviation_m: FloatArray
    distance_m: FloatArray
    driven_m: FloatArray
    shunts: IntArray
    touched: IntArray


class ParkingWorld:
    """N lots with up to K karts each. Every lot begins anew alone, and what happens in it depends on no other lot.

    Attributes:
        lots: Number N.
        karts: Number K.
        tables: What stands in the lots, and how the episodes go.
    """

    def __init__(self, lots: int, karts: int = 1) -> None:
        """Makes empty lots.

        Args:
            lots: Number of lots.
            karts: Most karts in a lot, 1 to 8.

        Raises:
            InvalidInputError: There is no lot or no kart, or there are more than 8 karts.
        """
        if lots < 1 or karts < 1:
            raise InvalidInputError(f"expected at least one lot and one kart, got {lots} and {karts}")
        if karts > MAX_KARTS:
            raise InvalidInputError(f"expected at most {MAX_KARTS} karts in a lot, got {karts}")
        self.lots, self.karts = lots, karts
        self.tables = Tables.empty(lots, karts)
        self._rewards = np.zeros((lots, karts))
        self._observations = np.zeros((lots, karts, COLUMNS), np.float32)

    @property
    def running(self) -> BoolArray:
        """(N, K) whether a kart's episode has begun and not ended."""
        return np.asarray(self.tables.counts[:, OUTCOME].reshape(self.lots, self.karts) == Outcome.RUNNING)

    def draw(
        self, lots: Sequence[int] | IntArray, seeds: Sequence[int] | IntArray, scene: Scene, rules: Rules = JUDGED
    ) -> None:
        """Begins episodes in lots drawn from seeds, all with K karts.

        Args:
            lots: (R,) indices of the lots.
            seeds: (R,) one each, in [0, 2^63).
            scene: Kind of lot.
            rules: When an episode ends.

        Raises:
            InvalidInputError: There are more karts than such a lot may have spots.
        """
        if self.karts > (most := most_karts(name := Scene(scene).name.lower())):
            raise InvalidInputError(
                f"expected at most {most} karts in a lot of the scene '{name}', which may have only {most} spots, "
                f"got {self.karts}"
            )
        rows = np.asarray(lots, np.int64)
        self.tables.rules[rows] = rules.row()
        _draw_all(rows, np.asarray(seeds, np.int64), int(scene), self.tables)
        self._refresh(rows)

    def place(self, lot: int, scene: Lot, rules: Rules = JUDGED) -> None:
        """Begins an episode in a given lot.

        Args:
            lot: Index.
            scene: The lot.
            rules: When an episode ends.

        Raises:
            InvalidInputError: The lot has more karts than this world.
        """
        if len(scene.karts) > self.karts:
            raise InvalidInputError(f"expected a lot with at most {self.karts} karts, got {len(scene.karts)}")
        self.tables.rules[lot] = rules.row()
        write_lot(lot, scene, self.tables)
        starts = np.array([[pose.x_m, pose.y_m, pose.heading_rad] for pose in scene.karts])
        kernel.begin(lot, starts, self.tables)
        self._refresh(np.array([lot]))

    def step(self, actions: FloatArray) -> FloatArray:
        """Advances all lots in which an episode runs by 0.1 s.

        Args:
            actions: (N, K, 3) finite shares of motor torque, steering angle and brake torque; cut to [-1, 1].

        Returns:
            (N, K) rewards; 0 where no episode ran. They are overwritten by the next step.
        """
        which = self.running
        kernel.advance(self.tables, np.clip(actions, -1.0, 1.0).reshape(-1, 3), self._rewards.reshape(-1))
        self._observe(which)
        return self._rewards

    @property
    def observations(self) -> Float32Array:
        """(N, K, 64) last observation of each kart's episode, see `observation`; overwritten by the next step."""
        return self._observations

    def view(self, lot: int) -> LotView:
        """Rows of what stands and walks in a lot, and of its karts."""
        tables, counted = self.tables, self.tables.lots[lot]
        first, past = lot * self.karts, (lot + 1) * self.karts
        return LotView(
            walls=tables.walls[lot * MAX_WALLS :][: counted[WALLS]],
            boxes=tables.boxes[lot * MAX_BOXES :][: counted[BOXES]],
            spots=tables.spots[lot * MAX_SPOTS :][: counted[SPOTS]],
            walkers=tables.walkers[lot * MAX_PEDESTRIANS :][: counted[WALKERS]],
            karts=tables.karts[first:past],
            counts=tables.counts[first:past],
        )

    def lot(self, lot: int) -> Lot:
        """Description of a lot, with its karts where they are now, at rest, and pedestrians where they began.

        Raises:
            ValueError: A kart touches something or is more than 160 m away, so that no episode could begin so.
        """
        return describe(self.view(lot), int(self.tables.lots[lot, LIMIT]))

    def results(self, lots: Sequence[int] | IntArray | slice = slice(None)) -> Results:
        """How the karts of some lots stand."""
        rows = np.arange(self.lots * self.karts).reshape(self.lots, self.karts)[lots]
        counts, body = self.tables.counts[rows], self.tables.karts[rows]
        spot = self.tables.spots[rows // self.karts * MAX_SPOTS + counts[..., TARGET]]
        dx, dy = body[..., kart.X] - spot[..., 0], body[..., kart.Y] - spot[..., 1]
        error = np.abs(wrap_angle(body[..., kart.HEADING] - spot[..., 2]))
        inclination = np.minimum(error, np.pi - error)
        deviation = np.abs(dy * np.cos(spot[..., 2]) - dx * np.sin(spot[..., 2]))
        outcome = counts[..., OUTCOME]
        success = outcome == Outcome.PARKED
        return Results(
            outcome=outcome,
            success=success,
            aligned=success & (inclination <= ALIGNED_ANGLE_RAD) & (deviation < ALIGNED_DEVIATION_M),
            time_s=counts[..., ENDED].astype(np.float64) * kart.TICK_S,
            inclination_rad=inclination,
            deviation_m=deviation,
            distance_m=np.hypot(dx, dy),
            driven_m=body[..., kart.DRIVEN],
            shunts=counts[..., SHUNTS],
            touched=counts[..., TOUCHED],
        )

    def _refresh(self, lots: IntArray) -> None:
        which = np.zeros((self.lots, self.karts), np.bool_)
        which[lots] = True
        which &= self.running
        self._observations[lots] = 0.0
        self._observe(which)

    def _observe(self, which: BoolArray) -> None:
        observe(self.tables, which.reshape(-1), self._observations.reshape(-1, COLUMNS))


@njit(cache=True)
def _draw_all(lots: IntArray, seeds: IntArray, scene: int, tables: Tables) -> None:
    starts = np.empty((tables.karts.shape[0] // tables.lots.shape[0], 3))
    for row in range(lots.shape[0]):
        draw(lots[row], scene, seeds[row], tables, starts)
        kernel.begin(lots[row], starts, tables)
