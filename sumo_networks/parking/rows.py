"""Rows of one lot in the tables: written from a `Lot`, viewed, and described as a `Lot` again."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.limits import MAX_BOXES, MAX_PEDESTRIANS, MAX_SPOTS, MAX_WALLS
from dohyo.sumo_networks.parking.lot import (
    Block,
    Lot,
    ParkedCar,
    Pedestrian,
    Pose,
    Spot,
    SpotKind,
    Wall,
)
from dohyo.sumo_networks.parking.radar import Kind
from dohyo.sumo_networks.parking.rules import Outcome
from dohyo.sumo_networks.parking.tables import KIND, OUTCOME, WALK_RADIUS, WALK_SPEED, WALKED, Tables


@dataclass(frozen=True, slots=True)
class LotView:
    """Rows of one lot in the tables, with the columns that `tables` says; they change with the next step.

    Attributes:
        walls: (W, 4).
        boxes: (B, 9).
        spots: (S, 9).
        walkers: (P, 10).
        karts: (K, 10).
        counts: (K, 7).
    """

    walls: FloatArray
    boxes: FloatArray
    spots: FloatArray
    walkers: FloatArray
    karts: FloatArray
    counts: IntArray

    def frozen(self) -> LotView:
        """A copy that does not change and cannot be written to."""
        copies = {one.name: getattr(self, one.name).copy() for one in fields(self)}
        for rows in copies.values():
            rows.flags.writeable = False
        return LotView(**copies)


def write_lot(lot: int, given: Lot, tables: Tables) -> None:
    """Writes a lot into a row of the arrays."""
    ticks = round(given.time_limit_s / kart.TICK_S)
    counted = len(given.walls), len(given.boxes), len(given.spots), len(given.pedestrians)
    tables.lots[lot] = (*counted, ticks, 0)
    for row, wall in enumerate(given.walls, lot * MAX_WALLS):
        tables.walls[row] = wall.row()
    for row, box in enumerate(given.boxes, lot * MAX_BOXES):
        tables.boxes[row] = *box.row(), Kind.WALL if isinstance(box, Block) else Kind.CAR
    for number, spot in enumerate(given.spots):
        tables.spots[lot * MAX_SPOTS + number] = *spot.row(), number in given.free_spots
    for row, walker in enumerate(given.pedestrians, lot * MAX_PEDESTRIANS):
        tables.walkers[row, :WALKED] = walker.row()


def describe(view: LotView, ticks: int) -> Lot:
    """A lot from its rows, with a time limit in ticks; pedestrians at their first points, karts where they are."""
    cars, blocks = view.boxes[view.boxes[:, KIND] == Kind.CAR], view.boxes[view.boxes[:, KIND] == Kind.WALL]
    there = view.counts[:, OUTCOME] != Outcome.ABSENT
    return Lot(
        walls=tuple(
            Wall(**dict(zip(("x0_m", "y0_m", "x1_m", "y1_m"), row, strict=True))) for row in view.walls.tolist()
        ),
        blocks=tuple(Block(**_box(row)) for row in blocks),
        cars=tuple(ParkedCar(**_box(row)) for row in cars),
        spots=tuple(Spot(**_box(row), kind=_kind(row)) for row in view.spots),
        pedestrians=tuple(_pedestrian(row) for row in view.walkers),
        karts=tuple(Pose(**_pose(row[kart.X], row[kart.Y], row[kart.HEADING])) for row in view.karts[there]),
        time_limit_s=ticks * kart.TICK_S,
    )


def _pose(x: float, y: float, heading: float) -> dict[str, float]:
    return {"x_m": float(x), "y_m": float(y), "heading_rad": float(heading)}


def _box(row: FloatArray) -> dict[str, float]:
    return {**_pose(row[0], row[1], row[2]), "length_m": float(row[3]), "width_m": float(row[4])}


def _kind(row: FloatArray) -> SpotKind:
    """Kind of a spot of a row along x: by its angle to the row."""
    across = abs(math.sin(row[2]))
    if across > math.sin(math.radians(80.0)):
        return SpotKind.PERPENDICULAR
    return SpotKind.PARALLEL if across < math.sin(math.radians(10.0)) else SpotKind.ANGLED


def _pedestrian(row: FloatArray) -> Pedestrian:
    x0, y0, x1, y1 = row[:4].tolist()
    speed, radius = float(row[WALK_SPEED]), float(row[WALK_RADIUS])
    return Pedestrian(x0_m=x0, y0_m=y0, x1_m=x1, y1_m=y1, speed_mps=speed, radius_m=radius)
