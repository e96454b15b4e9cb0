"""Road map: a network and the infractions on it, laid out for SVG."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from dohyo.evaluation.records.record import Infraction
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.entries import is_mirrored

D = TypeVar("D")

LaneShape = tuple[FloatArray, float]
"""A lane to draw: (P, 2) centreline, m, network frame, and its width, m."""

MAP_MARGIN_M = 150.0


@dataclass(frozen=True, slots=True)
class Spot(Generic[D]):
    """An infraction on the map, m, y down."""

    x: float
    y: float
    drive: D
    infraction: Infraction


@dataclass(frozen=True, slots=True)
class Map(Generic[D]):
    """A network with the infractions on it. Boxes are SVG view boxes, m, y down.

    Attributes:
        network: Name of the network.
        note: Reason for missing lanes; empty if there are lanes.
        lanes: SVG path data by lane width, m.
        whole: Box of the whole network and all infractions.
        home: Box of the first view: the infractions and their surroundings.
        spots: Infractions with their places.
    """

    network: str
    note: str
    lanes: dict[float, str]
    whole: tuple[float, float, float, float]
    home: tuple[float, float, float, float]
    spots: tuple[Spot[D], ...]


def drivable_lanes(network: str) -> list[LaneShape]:
    """Lanes that cars may use.

    Args:
        network: Name in the catalog, or path of a SUMO net.

    Raises:
        InvalidInputError: If this machine does not have the network.
    """
    roads = load_network(network)
    return [
        (roads.lane_shape(int(lane)), float(roads.lanes.width[lane])) for lane in np.flatnonzero(roads.lanes.drivable)
    ]


def lay_out_map(
    network: str, marks: Iterable[tuple[D, Infraction]], lanes: Callable[[str], Iterable[LaneShape]]
) -> Map[D]:
    """Lays out a network and the infractions on it; a mirror image of left-hand traffic is drawn as the place is.

    Args:
        network: Name of the network.
        marks: Infractions, each with its drive.
        lanes: Function that returns the lanes of a network; if it raises InvalidInputError, the map has a note instead.
    """
    note, east = "", 1.0
    try:
        east = -1.0 if is_mirrored(network) else 1.0
        shapes = list(lanes(network))
    except InvalidInputError as error:
        shapes, note = [], f"The roads are missing: {error}"
    shapes = [(shape * (east, 1.0), width) for shape, width in shapes]
    spots = tuple(_spots(marks, east))
    places = np.array([(spot.x, spot.y) for spot in spots]).reshape(-1, 2)
    roads = np.concatenate([shape * (1.0, -1.0) for shape, _ in shapes] or [np.empty((0, 2))])
    whole = _box(np.concatenate([roads, places]), 0.03, 10.0)
    home = _box(places, 0.1, MAP_MARGIN_M) if len(places) else whole
    if whole[2] * whole[3] < 4 * home[2] * home[3]:
        home = whole
    return Map(network, note, _lane_paths(shapes), whole, home, spots)


def _box(points: FloatArray, margin: float, margin_m: float) -> tuple[float, float, float, float]:
    """View box x, y, width, height of points (N, 2), grown by a share of its size and some metres."""
    if not len(points):
        return 0.0, 0.0, 2 * margin_m, 2 * margin_m
    low, high = points.min(axis=0), points.max(axis=0)
    low, high = low - margin * (high - low) - margin_m, high + margin * (high - low) + margin_m
    x, y, width, height = (round(float(value), 1) for value in (*low, *(high - low)))
    return x, y, width, height


def _lane_paths(shapes: Iterable[LaneShape]) -> dict[float, str]:
    """All centrelines of one width as one SVG path, with a resolution of 0.1 m, y down."""
    paths: dict[float, list[str]] = {}
    for shape, width in shapes:
        decimetres = np.rint(shape * (10.0, -10.0)).astype(int)
        first, steps = decimetres[0] / 10, np.diff(decimetres, axis=0) / 10
        line = "".join(f"l{dx:g} {dy:g}" for dx, dy in steps if dx or dy)
        paths.setdefault(round(width, 1), []).append(f"M{first[0]:.1f} {first[1]:.1f}{line}")
    return {width: "".join(lines) for width, lines in sorted(paths.items())}


def _spots(marks: Iterable[tuple[D, Infraction]], east: float) -> Iterator[Spot[D]]:
    """One spot per infraction, at the place where it happened; the page counts those that overlap."""
    for drive, one in marks:
        yield Spot(round(east * one.x_m, 1), round(0.0 - one.y_m, 1), drive, one)
