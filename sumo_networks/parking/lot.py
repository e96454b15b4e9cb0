"""Lot: everything that is needed to drive in a parking lot again: walls, spots, parked cars, pedestrians, karts.

Metres and radians in the lot's frame: x to the east, y to the north, angles counter-clockwise from +x. A position is
the centre of a box.
"""

from __future__ import annotations

import math
from enum import StrEnum
from itertools import combinations
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.contact import STORED, boxes_touch, distance_to, store_box, touches_segment
from dohyo.sumo_networks.parking.limits import MAX_BOXES, MAX_KARTS, MAX_PEDESTRIANS, MAX_SPOTS, MAX_WALLS

TIME_LIMIT_S = 60.0
_SHARED_LINE_M = 0.02
"""Spots side by side share a line; they overlap if they share more than this."""
_WALL_MARGIN_M = 0.1
"""A wall along an edge of a spot may be so far inside it."""

Size = Annotated[float, Field(gt=0, le=100)]
Coordinate = Annotated[float, Field(ge=-160, le=160)]
"""As far as columns of an observation reach, see `dohyo.sumo_networks.parking.observation`."""


class SpotKind(StrEnum):
    """How a spot lies beside its lane."""

    PERPENDICULAR = "perpendicular"
    PARALLEL = "parallel"
    ANGLED = "angled"


class Pose(Config):
    """Place and direction in a lot.

    Attributes:
        x_m: Centre.
        y_m: Centre.
        heading_rad: Direction; of a spot: that of a kart that drives in forwards.
    """

    x_m: Coordinate
    y_m: Coordinate
    heading_rad: Annotated[float, Field(ge=-7, le=7)] = 0.0


class Wall(Config):
    """A wall without thickness, from one point to another."""

    x0_m: Coordinate
    y0_m: Coordinate
    x1_m: Coordinate
    y1_m: Coordinate

    def row(self) -> FloatArray:
        """(4,) both ends."""
        return np.array([self.x0_m, self.y0_m, self.x1_m, self.y1_m])


class OrientedBox(Pose):
    """An oriented rectangle.

    Attributes:
        length_m: Size along its heading.
        width_m: Size across it.
    """

    length_m: Size
    width_m: Size

    def row(self, margin_m: float = 0.0) -> FloatArray:
        """(8,) stored box of `dohyo.sumo_networks.parking.contact`, smaller by a margin on length and width."""
        boxes = np.empty((1, STORED))
        length, width = max(self.length_m - margin_m, 0.0), max(self.width_m - margin_m, 0.0)
        store_box(boxes, 0, self.x_m, self.y_m, self.heading_rad, length, width)
        return np.asarray(boxes[0])


class ParkedCar(OrientedBox):
    """A parked car."""


class Block(OrientedBox):
    """A block of wall, such as a pillar; a radar reports it as a wall."""


class Spot(OrientedBox):
    """A parking spot: a painted rectangle in which a kart fits. It is taken if a car, a block or a wall is in it.

    Attributes:
        kind: How it lies beside its lane.
    """

    kind: SpotKind = SpotKind.PERPENDICULAR


class Pedestrian(Config):
    """A disc that walks from one point to another and back. It waits for karts in its way, and turns back after 2 s.

    Attributes:
        x0_m: First point, where it begins.
        y0_m: First point.
        x1_m: Second point.
        y1_m: Second point.
        speed_mps: Walking speed.
        radius_m: Of the disc.
    """

    x0_m: Coordinate
    y0_m: Coordinate
    x1_m: Coordinate
    y1_m: Coordinate
    speed_mps: Annotated[float, Field(ge=0, le=3)] = 1.2
    radius_m: Annotated[float, Field(gt=0, le=1)] = 0.3

    def row(self) -> FloatArray:
        """(6,) both points, speed, radius."""
        return np.array([self.x0_m, self.y0_m, self.x1_m, self.y1_m, self.speed_mps, self.radius_m])


class Lot(Config):
    """A parking lot at the beginning of an episode.

    Every kart heads for the nearest spot that is free when the episode begins. When another kart's centre is in that
    spot, it heads for the nearest spot that is still free.

    Attributes:
        walls: Walls.
        blocks: Blocks of wall.
        cars: Parked cars.
        spots: Spots, with the taken ones.
        pedestrians: Pedestrians.
        karts: Start of each kart, at rest.
        time_limit_s: Time in which every kart must park, 0.1 to 600 s; rounded to ticks of 0.1 s.
    """

    walls: Annotated[tuple[Wall, ...], Field(max_length=MAX_WALLS)] = ()
    blocks: tuple[Block, ...] = ()
    cars: tuple[ParkedCar, ...] = ()
    spots: Annotated[tuple[Spot, ...], Field(max_length=MAX_SPOTS)]
    pedestrians: Annotated[tuple[Pedestrian, ...], Field(max_length=MAX_PEDESTRIANS)] = ()
    karts: Annotated[tuple[Pose, ...], Field(min_length=1, max_length=MAX_KARTS)]
    time_limit_s: Annotated[float, Field(ge=kart.TICK_S, le=600)] = TIME_LIMIT_S

    @model_validator(mode="after")
    def _can_be_driven(self) -> Lot:
        if len(self.blocks) + len(self.cars) > MAX_BOXES:
            raise ValueError(f"expected at most {MAX_BOXES} blocks and cars, got {len(self.blocks) + len(self.cars)}")
        self._check_spots()
        for number, start in enumerate(self.karts):
            if obstacle := self._touched(number, start):
                raise ValueError(f"kart {number} starts in {obstacle}, at {_place(start)}")
        return self

    @property
    def boxes(self) -> tuple[OrientedBox, ...]:
        """Blocks, then parked cars."""
        return (*self.blocks, *self.cars)

    @property
    def free_spots(self) -> tuple[int, ...]:
        """Indices of the spots that no block or parked car overlaps and no wall crosses."""
        boxes, walls = [box.row() for box in self.boxes], [wall.row() for wall in self.walls]
        return tuple(
            number
            for number, spot in enumerate(self.spots)
            if not any(_touch(spot.row(_SHARED_LINE_M), box) for box in boxes)
            and not any(_meets(spot.row(2.0 * _WALL_MARGIN_M), wall) for wall in walls)
        )

    def _check_spots(self) -> None:
        for number, spot in enumerate(self.spots):
            if spot.length_m < kart.LENGTH_M or spot.width_m < kart.WIDTH_M:
                raise ValueError(
                    f"spot {number}, at {_place(spot)}: expected room for a kart, {kart.LENGTH_M} x {kart.WIDTH_M} m, "
                    f"got {spot.length_m:g} x {spot.width_m:g} m"
                )
        rows = [spot.row(_SHARED_LINE_M) for spot in self.spots]
        for one, other in combinations(range(len(rows)), 2):
            if _touch(rows[one], rows[other]):
                where = f"at {_place(self.spots[one])} and {_place(self.spots[other])}"
                raise ValueError(f"spots {one} and {other} overlap, {where}")
        if not self.free_spots:
            raise ValueError(f"no spot is free: parked cars, blocks or walls are in all {len(self.spots)} spots")

    def _touched(self, number: int, start: Pose) -> str:
        """What a kart's box touches at its start; empty: nothing."""
        box = kart_box(start)
        for kind, others in (("block", self.blocks), ("parked car", self.cars)):
            for index, other in enumerate(others):
                if _touch(box, other.row()):
                    return f"{kind} {index}"
        for index, wall in enumerate(self.walls):
            if _meets(box, wall.row()):
                return f"wall {index}"
        for index, walker in enumerate(self.pedestrians):
            if distance_to(box[None], 0, walker.x0_m, walker.y0_m) <= walker.radius_m:
                return f"pedestrian {index}"
        for index, one in enumerate(self.karts[:number]):
            if _touch(box, kart_box(one)):
                return f"kart {index}"
        return ""


def kart_box(pose: Pose) -> FloatArray:
    """(8,) stored box of a kart."""
    box = OrientedBox(**pose.model_dump(), length_m=kart.LENGTH_M, width_m=kart.WIDTH_M)
    return box.row()


def _touch(a: FloatArray, b: FloatArray) -> bool:
    return bool(boxes_touch(a[None], 0, b[None], 0))


def _meets(box: FloatArray, wall: FloatArray) -> bool:
    return bool(touches_segment(box[None], 0, tuple(wall.tolist())))


def _place(pose: Pose) -> str:
    return f"({pose.x_m:.2f}, {pose.y_m:.2f}) m, {math.degrees(pose.heading_rad):.0f} degrees"
