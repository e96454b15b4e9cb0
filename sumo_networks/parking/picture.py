"""Plan view of a lot as an RGB picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.radar import Kind
from dohyo.sumo_networks.parking.rows import LotView
from dohyo.sumo_networks.parking.rules import Outcome
from dohyo.sumo_networks.parking.tables import FREE, KIND, OUTCOME, TARGET, WALK_RADIUS, WALK_SPEED, WALK_X, WALK_Y

SIZE: Final = 480
_FINE: Final = 2
"""Pictures are drawn larger and made smaller, for smooth edges."""
_MARGIN_M: Final = 3.0
_EDGE_MARGIN_M: Final = 0.5
"""Least distance of corners from the edge of the picture; that of centres and ends of walls is `_MARGIN_M`."""
_SAND, _GROUND, _LINE, _CAR, _WALL = "#FAF8F4", "#E9E5DC", "#B9B3A6", "#9AA3AF", "#1F2328"
_TARGET, _WALKER = "#2E7D5B", "#B7791F"
KARTS: Final = ("#5B4B8A", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#6B7280")


def draw_picture(view: LotView, size: int = SIZE, ways: Sequence[FloatArray] = ()) -> NDArray[np.uint8]:
    """Draws a lot: spots, targets in green, parked cars, walls, pedestrians, and karts with a notch at the front.

    Args:
        view: Rows of the lot.
        size: Width and height, pixels.
        ways: (P, 2) points of a line for each kart, drawn below it, m.

    Returns:
        (size, size, 3) RGB, north up.
    """
    picture = Image.new("RGB", (size * _FINE, size * _FINE), _SAND)
    pen = ImageDraw.Draw(picture)
    place = _placing(view, size * _FINE, ways)
    there = [row for row in range(len(view.karts)) if view.counts[row, OUTCOME] != Outcome.ABSENT]
    targets = {int(view.counts[row, TARGET]) for row in there}
    for number, spot in enumerate(view.spots):
        target = number in targets and spot[FREE] != 0.0
        corners = place(_corners(spot))
        pen.polygon(corners, fill=_GROUND)
        pen.line([*corners, corners[0]], fill=_TARGET if target else _LINE, width=3 * _FINE if target else _FINE)
    for box in view.boxes:
        pen.polygon(place(_corners(box)), fill=_WALL if box[KIND] == Kind.WALL else _CAR)
    for wall in view.walls:
        pen.line(place(wall.reshape(2, 2)), fill=_WALL, width=2 * _FINE)
    for walker in view.walkers:
        at = np.array([[walker[WALK_X], walker[WALK_Y]]])
        reach = walker[WALK_RADIUS] * np.array([[-1.0, 1.0], [1.0, -1.0]])
        pen.ellipse(place(at + reach), fill=_WALKER)
    for row, way in enumerate(ways):
        pen.line(place(way), fill=KARTS[row % len(KARTS)], width=2 * _FINE)
    for row in there:
        _draw_kart(pen, place, view.karts[row], KARTS[row % len(KARTS)])
    small = picture.resize((size, size), Image.Resampling.BOX)
    return np.asarray(small, dtype=np.uint8)


def _draw_kart(pen: ImageDraw.ImageDraw, place: Any, body: FloatArray, colour: str) -> None:
    box = np.array([body[kart.X], body[kart.Y], body[kart.HEADING], kart.LENGTH_M, kart.WIDTH_M])
    corners = _corners(box)
    pen.polygon(place(corners), fill=colour)
    ahead = 0.5 * (corners[0] + corners[3])
    notch = np.array([corners[0], corners[3], ahead + 0.35 * (box[:2] - ahead)])
    pen.polygon(place(notch), fill=_SAND)


def _corners(box: FloatArray) -> FloatArray:
    """(4, 2) corners: front left, rear left, rear right, front right."""
    cos, sin = math.cos(box[2]), math.sin(box[2])
    local = 0.5 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * box[3:5]
    return np.asarray(box[:2] + local @ np.array([[cos, sin], [-sin, cos]]))


def _edges(view: LotView) -> FloatArray:
    """(P, 2) corners of spots and boxes, and corners around the discs of pedestrians at both ends of their ways."""
    ends, radius = view.walkers[:, :WALK_SPEED].reshape(-1, 2), view.walkers[:, WALK_RADIUS].repeat(2)[:, None]
    corners = [_corners(box) for box in (*view.spots, *view.boxes)]
    return np.concatenate([ends - radius, ends + radius, *corners])


def _placing(view: LotView, pixels: int, ways: Sequence[FloatArray] = ()) -> Any:
    """A function from (P, 2) points in the lot to pixels, so that everything in the lot and every way is seen."""
    centres = [view.walls.reshape(-1, 2), view.spots[:, :2], view.boxes[:, :2], view.karts[:, [kart.X, kart.Y]], *ways]
    points, edges = np.concatenate(centres), _edges(view)
    low = np.min([*(points - _MARGIN_M), *(edges - _EDGE_MARGIN_M)], axis=0)
    high = np.max([*(points + _MARGIN_M), *(edges + _EDGE_MARGIN_M)], axis=0)
    scale = pixels / float((high - low).max())
    offset = 0.5 * (pixels - scale * (high + low))

    def place(some: FloatArray) -> list[tuple[float, float]]:
        at = offset + scale * some
        return [(float(x), float(pixels - y)) for x, y in at]

    return place
