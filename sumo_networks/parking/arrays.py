"""Arrays of N lots with up to K karts: what stands in them, and how their episodes go."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.lot import MAX_BOXES, MAX_PEDESTRIANS, MAX_SPOTS, MAX_WALLS
from dohyo.sumo_networks.parking.radar import PACKED
from dohyo.sumo_networks.parking.rules import WIDTH, Outcome


class Scenery(NamedTuple):
    """What stands in N lots, or walks.

    Attributes:
        walls: (N, 16, 4) ends, m.
        wall_count: (N,).
        boxes: (N, 32, 5) blocks and parked cars.
        packed: (N, 32, 7) the same for the radar.
        box_kind: (N, 32) kind that the radar reports.
        box_count: (N,).
        spots: (N, 24, 5) boxes.
        spot_free: (N, 24) whether nothing stands in the spot.
        spot_count: (N,).
        walkers: (N, 8, 6) pedestrians: two points [m], speed [m/s], radius [m].
        walker_count: (N,).
        ticks: (N,) time limit in ticks.
    """

    walls: FloatArray
    wall_count: IntArray
    boxes: FloatArray
    packed: FloatArray
    box_kind: IntArray
    box_count: IntArray
    spots: FloatArray
    spot_free: BoolArray
    spot_count: IntArray
    walkers: FloatArray
    walker_count: IntArray
    ticks: IntArray

    @classmethod
    def empty(cls, lots: int) -> Scenery:
        """N empty lots."""
        none = np.zeros(lots, np.int64)
        return cls(
            walls=np.zeros((lots, MAX_WALLS, 4)),
            wall_count=none.copy(),
            boxes=np.zeros((lots, MAX_BOXES, 5)),
            packed=np.zeros((lots, MAX_BOXES, PACKED)),
            box_kind=np.zeros((lots, MAX_BOXES), np.int64),
            box_count=none.copy(),
            spots=np.zeros((lots, MAX_SPOTS, 5)),
            spot_free=np.zeros((lots, MAX_SPOTS), np.bool_),
            spot_count=none.copy(),
            walkers=np.zeros((lots, MAX_PEDESTRIANS, 6)),
            walker_count=none.copy(),
            ticks=none.copy(),
        )


class Episodes(NamedTuple):
    """How the episodes of N lots with K karts go.

    Attributes:
        karts: (N, K, 7) states of the karts, see `dohyo.sumo_networks.parking.kart`.
        outcome: (N, K) `Outcome`.
        target: (N, K) index of the spot that the kart heads for.
        held: (N, K) substeps in place without a break.
        touched: (N, K) kind of what the kart has touched; 0: nothing.
        driven_m: (N, K) distance driven.
        shunts: (N, K) changes between forwards and backwards.
        gear: (N, K) direction of the last motion: 1, -1, or 0 before the first.
        walked_m: (N, 8) way of each pedestrian, which turns at both ends.
        tick: (N,) ticks since the episode began.
        ended_at: (N, K) tick in which the kart's episode ended.
        rules: (N, 9) rows of `Rules`.
    """

    karts: FloatArray
    outcome: IntArray
    target: IntArray
    held: IntArray
    touched: IntArray
    driven_m: FloatArray
    shunts: IntArray
    gear: IntArray
    walked_m: FloatArray
    tick: IntArray
    ended_at: IntArray
    rules: FloatArray

    @classmethod
    def empty(cls, lots: int, karts: int) -> Episodes:
        """N lots whose episodes have not begun."""
        none = np.zeros((lots, karts), np.int64)
        return cls(
            karts=np.zeros((lots, karts, kart.STATE)),
            outcome=np.full((lots, karts), int(Outcome.ABSENT)),
            target=none.copy(),
            held=none.copy(),
            touched=none.copy(),
            driven_m=np.zeros((lots, karts)),
            shunts=none.copy(),
            gear=none.copy(),
            walked_m=np.zeros((lots, MAX_PEDESTRIANS)),
            tick=np.zeros(lots, np.int64),
            ended_at=none.copy(),
            rules=np.zeros((lots, WIDTH)),
        )
