"""ObjectStates: a table of moving or standing boxes, one per row; base class of all such tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray, column

BoxColumns = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""Position, heading, speed, length and width of N boxes, for kernels: numba reads a named tuple 1 us slower."""


@dataclass(frozen=True, slots=True)
class ObjectStates:
    """Poses, sizes and speeds of N boxes. Every field is a column; tables with more columns derive from this class.

    Attributes:
        key: (N,) number of the object, stable within the episode.
        kind: (N,) `world.ActorKind`.
        position: (N, 2), m: centre of the box, in the frame of the table.
        heading: (N,), rad, counter-clockwise from the frame's +x.
        speed: (N,), m/s, along the heading.
        length: (N,), m.
        width: (N,), m.
    """

    key: IntArray = column(np.int64)
    kind: IntArray = column(np.int64)
    position: FloatArray = column(np.float64, 2)
    heading: FloatArray = column(np.float64)
    speed: FloatArray = column(np.float64)
    length: FloatArray = column(np.float64)
    width: FloatArray = column(np.float64)

    def __len__(self) -> int:
        return len(self.key)

    def boxes(self) -> FloatArray:
        """(N, 5) x, y [m], heading [rad], length, width [m]."""
        return stack_boxes(self.position, self.heading, self.length, self.width)

    def box(self, row: int) -> FloatArray:
        """(5,) x, y [m], heading [rad], length, width [m] of one object."""
        return np.array([*self.position[row], self.heading[row], self.length[row], self.width[row]], dtype=np.float64)

    def columns(self) -> BoxColumns:
        """Boxes and speeds of the objects, for numba kernels."""
        return self.position, self.heading, self.speed, self.length, self.width

    def take(self, rows: IntArray | BoolArray) -> Self:
        """Table of the selected rows, by index (in that order) or by mask."""
        # __match_args__ lists all columns, inherited ones first, and is faster to read than dataclasses.fields.
        return type(self)(*[getattr(self, name)[rows] for name in self.__match_args__])

    @classmethod
    def concat(cls, tables: Sequence[Self]) -> Self:
        """Joins the rows of one or more tables, in the order of the tables."""
        return cls(*[np.concatenate([getattr(table, name) for table in tables]) for name in cls.__match_args__])

    @classmethod
    def empty(cls) -> Self:
        """A table without rows."""
        return cls(*[one.metadata["empty"] for one in fields(cls)])


def stack_boxes(position: FloatArray, heading: FloatArray, length: FloatArray, width: FloatArray) -> FloatArray:
    """(N, 5) boxes, as `geometry` takes them, from (N, 2) and three (N,) columns."""
    out = np.empty((len(heading), 5))
    out[:, :2], out[:, 2], out[:, 3], out[:, 4] = position, heading, length, width
    return out
