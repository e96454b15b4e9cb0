"""Bodies: models of actors, as a few boxes each.

A part is a box whose top may be smaller than its bottom. Its bounds along and across are shares of half the actor's
length and width, so that it fits actors of any size; heights are in metres.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum, IntFlag

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.world import ActorKind

COLUMNS = 12
Part = tuple[float, ...]


class Paint(IntEnum):
    """Colour of a part; OWN is the colour of the actor."""

    OWN = 0
    GLASS = 1
    TYRE = 2
    HEADLAMP = 3
    TAILLAMP = 4
    INDICATOR = 5
    SKIN = 6
    TROUSERS = 7
    CARGO = 8
    WHITE = 9
    RED = 10
    BLUE_LAMP = 11
    CHASSIS = 12
    PLATE = 13
    SPOKES = 14


class When(IntFlag):
    """Flags of drawing a part: NEAR only if it may be bigger than a pixel, COLOUR only in colour pictures."""

    ALWAYS = 0
    NEAR = 1
    LEFT_INDICATOR = 2
    RIGHT_INDICATOR = 4
    SHINES = 8
    COLOUR = 16


ON_TOP = When.NEAR | When.COLOUR
"""A patch of colour about a centimetre in front of another part: without effect on labels and depth."""


PAINTS: IntArray = np.array(
    [
        (128, 128, 128),
        (46, 56, 68),
        (34, 35, 38),
        (255, 246, 214),
        (196, 28, 30),
        (255, 160, 20),
        (222, 176, 146),
        (52, 56, 74),
        (226, 226, 222),
        (240, 240, 238),
        (206, 38, 34),
        (40, 110, 255),
        (58, 60, 64),
        (232, 232, 226),
        (92, 94, 98),
    ]
)
"""(15, 3) colours by Paint."""

CAR_PAINTS: IntArray = np.array(
    [
        (226, 228, 230),
        (168, 173, 178),
        (84, 89, 96),
        (38, 42, 50),
        (174, 40, 42),
        (40, 78, 138),
        (74, 112, 92),
        (206, 186, 148),
        (118, 46, 62),
        (90, 140, 180),
    ]
)
CLOTHES: IntArray = np.array(
    [
        (196, 62, 52),
        (44, 98, 150),
        (232, 190, 70),
        (70, 128, 86),
        (146, 84, 150),
        (222, 222, 216),
        (52, 58, 70),
        (226, 128, 64),
    ]
)
BUS_PAINTS: IntArray = np.array([(240, 196, 48), (206, 52, 46), (60, 132, 140)])


def _part(
    x: tuple[float, float],
    y: tuple[float, float],
    z: tuple[float, float],
    side: Paint,
    top: Paint | None = None,
    when: When = When.ALWAYS,
    top_x: tuple[float, float] | None = None,
    narrower: float = 1.0,
) -> Part:
    """Makes a part: bounds along, across and in height; `top_x` along at its top, and `narrower` times as wide."""
    upper = top_x or x
    return (*x, *y, *z, *upper, narrower, float(side), float(side if top is None else top), float(when))


def _both_sides(low: float, high: float) -> tuple[tuple[float, float], tuple[float, float]]:
    return (low, high), (-high, -low)


def _wheels(*at: float, radius: float, length: float) -> Iterator[Part]:
    """Pairs of wheels; `length` is that of the typical vehicle, m."""
    half = 2 * radius / length
    for middle in at:
        for y in _both_sides(0.72, 1.003):
            yield from _wheel(middle, half, y, radius, Paint.TYRE, When.NEAR)


def _wheel(
    middle: float, half: float, y: tuple[float, float], radius: float, paint: Paint, when: When
) -> Iterator[Part]:
    """A wheel as a hexagon: a box that widens, and a box that narrows."""
    wide, narrow = (middle - half, middle + half), (middle - half / 2, middle + half / 2)
    yield _part(narrow, y, (0.0, radius), paint, when=when, top_x=wide)
    yield _part(wide, y, (radius, 2 * radius), paint, when=when, top_x=narrow)


def _lamps(low: float, high: float) -> Iterator[Part]:
    """Head lamps, tail lamps and indicators between two heights."""
    for y in _both_sides(0.52, 0.9):
        yield _part((0.985, 1.004), y, (low, high), Paint.HEADLAMP, when=ON_TOP | When.SHINES)
        yield _part((-1.004, -0.985), y, (low + 0.04, high + 0.04), Paint.TAILLAMP, when=ON_TOP | When.SHINES)
    for y, when in zip(_both_sides(0.78, 1.006), (When.LEFT_INDICATOR, When.RIGHT_INDICATOR), strict=True):
        for x in ((0.93, 1.006), (-1.006, -0.93)):
            yield _part(x, y, (low + 0.02, high - 0.02), Paint.INDICATOR, when=when | ON_TOP | When.SHINES)


def _car() -> Iterator[Part]:
    yield _part((-0.96, 0.96), (-0.9, 0.9), (0.16, 0.34), Paint.CHASSIS)
    yield _part((-1.0, 1.0), (-1.0, 1.0), (0.3, 0.62), Paint.OWN)
    yield _part((-1.0, 1.0), (-1.0, 1.0), (0.62, 0.88), Paint.OWN, top_x=(-0.97, 0.95), narrower=0.93)
    yield _part((-0.88, 0.44), (-0.92, 0.92), (0.88, 1.4), Paint.GLASS, top_x=(-0.64, 0.1), narrower=0.82)
    yield _part((-0.65, 0.11), (-0.76, 0.76), (1.4, 1.48), Paint.OWN, top_x=(-0.6, 0.06), narrower=0.94)
    yield from _wheels(-0.6, 0.6, radius=0.32, length=4.6)
    yield from _lamps(0.58, 0.76)
    for x in ((-1.005, -0.98), (0.98, 1.005)):
        yield _part(x, (-0.26, 0.26), (0.4, 0.52), Paint.PLATE, when=ON_TOP)


def _van(stripe: bool = False) -> Iterator[Part]:
    yield _part((-0.98, 0.98), (-0.9, 0.9), (0.18, 0.4), Paint.CHASSIS)
    yield _part((-1.0, 1.0), (-1.0, 1.0), (0.36, 1.15), Paint.OWN, top_x=(-1.0, 0.97))
    yield _part((-1.0, 0.44), (-1.0, 1.0), (1.15, 2.4), Paint.OWN, top_x=(-0.99, 0.44), narrower=0.94)
    yield _part((0.44, 0.84), (-0.97, 0.97), (1.15, 2.2), Paint.GLASS, Paint.OWN, top_x=(0.44, 0.56), narrower=0.94)
    yield _part((0.44, 0.57), (-0.92, 0.92), (2.2, 2.4), Paint.OWN, top_x=(0.44, 0.5))
    yield _part((-1.003, -0.99), (-0.75, 0.75), (1.4, 2.05), Paint.GLASS, when=ON_TOP)
    yield from _wheels(-0.6, 0.66, radius=0.36, length=6.2)
    yield from _lamps(0.7, 0.92)
    if stripe:
        yield _part((-1.003, 0.98), (-1.006, 1.006), (0.85, 1.15), Paint.RED, when=When.COLOUR)
        yield _part((0.2, 0.34), (-0.7, 0.7), (2.4, 2.6), Paint.BLUE_LAMP, when=When.SHINES)
        yield _part((-0.94, -0.84), (-0.7, 0.7), (2.4, 2.55), Paint.BLUE_LAMP, when=When.SHINES)


def _truck() -> Iterator[Part]:
    yield _part((-1.0, 0.98), (-0.85, 0.85), (0.5, 1.0), Paint.CHASSIS)
    yield _part((0.62, 1.0), (-1.0, 1.0), (0.4, 1.55), Paint.OWN)
    yield _part((0.62, 1.0), (-1.0, 1.0), (1.55, 2.5), Paint.GLASS, Paint.OWN, top_x=(0.62, 0.97), narrower=0.97)
    yield _part((0.62, 0.975), (-0.98, 0.98), (2.5, 2.95), Paint.OWN, top_x=(0.62, 0.92))
    yield _part((0.62, 0.75), (-1.004, 1.004), (1.5, 2.55), Paint.OWN, when=When.COLOUR)
    yield _part((-1.0, 0.57), (-1.0, 1.0), (1.0, 3.6), Paint.CARGO)
    yield from _wheels(-0.72, -0.46, 0.74, radius=0.5, length=9.5)
    yield from _lamps(0.6, 0.84)


def _bus() -> Iterator[Part]:
    yield _part((-1.0, 1.0), (-1.0, 1.0), (0.28, 2.85), Paint.OWN)
    yield _part((-0.98, 0.97), (-0.95, 0.95), (2.85, 3.1), Paint.CARGO)
    yield _part((-0.96, 0.98), (-1.004, 1.004), (1.3, 2.35), Paint.GLASS, when=When.COLOUR)
    for middle in (-0.58, -0.18, 0.22, 0.62):
        yield _part((middle - 0.012, middle + 0.012), (-1.007, 1.007), (1.28, 2.37), Paint.OWN, when=ON_TOP)
    yield _part((0.99, 1.003), (-0.92, 0.92), (1.0, 2.45), Paint.GLASS, when=When.COLOUR)
    yield _part((-1.003, -0.99), (-0.8, 0.8), (1.5, 2.35), Paint.GLASS, when=When.COLOUR)
    yield from _wheels(-0.56, 0.52, radius=0.48, length=12.0)
    yield from _lamps(0.6, 0.84)


def _bicycle() -> Iterator[Part]:
    for middle in (-0.63, 0.63):
        yield from _wheel(middle, 0.37, (-0.06, 0.06), 0.32, Paint.SPOKES, When.ALWAYS)
    yield _part((-0.5, 0.5), (-0.08, 0.08), (0.42, 0.6), Paint.RED)
    yield _part((0.42, 0.56), (-0.75, 0.75), (0.98, 1.04), Paint.TYRE, when=When.NEAR)
    for y in _both_sides(0.1, 0.42):
        yield _part((-0.2, 0.14), y, (0.3, 0.95), Paint.TROUSERS, top_x=(-0.34, 0.0))
    yield _part((-0.36, 0.02), (-0.62, 0.62), (0.9, 1.45), Paint.OWN, top_x=(-0.06, 0.24), narrower=0.85)
    yield _part((0.04, 0.3), (-0.3, 0.3), (1.47, 1.72), Paint.SKIN, Paint.TYRE)
    yield _part((-1.005, -0.96), (-0.1, 0.1), (0.6, 0.72), Paint.TAILLAMP, when=ON_TOP | When.SHINES)


def _pedestrian() -> Iterator[Part]:
    for y in _both_sides(0.06, 0.52):
        yield _part((-0.42, 0.42), y, (0.0, 0.84), Paint.TROUSERS)
    yield _part((-0.46, 0.46), (-0.82, 0.82), (0.8, 1.42), Paint.OWN, top_x=(-0.4, 0.4), narrower=0.86)
    yield _part((-0.4, 0.4), (-0.36, 0.36), (1.46, 1.64), Paint.SKIN)
    yield _part((-0.44, 0.4), (-0.4, 0.4), (1.6, 1.72), Paint.TYRE)


def _obstacle() -> Iterator[Part]:
    edges = np.linspace(-1.0, 1.0, 7).tolist()
    for level in range(2):
        for number in range(6):
            colour = (Paint.RED, Paint.WHITE)[(number + level) % 2]
            yield _part((edges[number], edges[number + 1]), (-1.0, 1.0), (0.5 * level, 0.5 * level + 0.5), colour)


def _tables() -> tuple[FloatArray, IntArray]:
    by_kind = {
        ActorKind.CAR: _car(),
        ActorKind.VAN: _van(),
        ActorKind.TRUCK: _truck(),
        ActorKind.BUS: _bus(),
        ActorKind.BICYCLE: _bicycle(),
        ActorKind.EMERGENCY: _van(stripe=True),
        ActorKind.PEDESTRIAN: _pedestrian(),
        ActorKind.STATIC: _obstacle(),
        ActorKind.EGO: _car(),
    }
    rows = [list(by_kind[kind]) for kind in ActorKind]
    start = np.concatenate([[0], np.cumsum([len(parts) for parts in rows])]).astype(np.int64)
    return np.array([part for parts in rows for part in parts], dtype=np.float64), start


PARTS, PARTS_START = _tables()
HEIGHT_M: FloatArray = np.array([PARTS[PARTS_START[k] : PARTS_START[k + 1], 5].max() for k in ActorKind])
"""(9,) height by ActorKind, m."""


def own_colours(kind: IntArray, key: IntArray) -> IntArray:
    """(M, 3) colour of each actor, by its kind and key."""
    return np.asarray(_OWN[kind, (key * 2654435761 >> 7) & 63])


def _own() -> IntArray:
    """(9, 64, 3) colours by kind and number."""
    out = np.empty((len(ActorKind), 64, 3), dtype=np.int64)
    number = np.arange(64)
    for kind in ActorKind:
        palette = CAR_PAINTS
        if kind in (ActorKind.PEDESTRIAN, ActorKind.BICYCLE):
            palette = CLOTHES
        elif kind is ActorKind.BUS:
            palette = BUS_PAINTS
        out[kind] = palette[number % len(palette)]
    out[ActorKind.VAN, number % 2 == 0] = PAINTS[Paint.WHITE]
    out[ActorKind.EMERGENCY] = PAINTS[Paint.WHITE]
    return out


_OWN = _own()
