"""Small extracts of OpenStreetMap, written by hand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

BERLIN = (52.5, 13.4)
BLACKPOOL = (53.8, -3.0)
"""On the middle meridian of its UTM zone, where north is up."""


def crossroads(place: tuple[float, float] = BERLIN, *, east: float = 1.0, tags: str = "") -> str:
    """Two roads that cross.

    Args:
        place: Latitude and longitude of the south-western corner, degrees.
        east: 1.0, or -1.0 for the mirror image.
        tags: Further tags of the road from west to east.
    """
    nodes = ((0.0015, 0.0), (0.0015, 0.0025), (0.0015, 0.0050), (0.0, 0.0025), (0.0035, 0.0030))
    return _extract(
        [(place[0] + north, place[1] + east * along) for north, along in nodes],
        [
            ((1, 2, 3), f'<tag k="highway" v="secondary"/><tag k="lanes" v="4"/>{tags}'),
            ((4, 2, 5), '<tag k="highway" v="secondary"/>'),
        ],
    )


def roundabout() -> str:
    """A roundabout with two arms, and nothing else."""
    nodes = ((0.0, 0.0), (0.0002, 0.0003), (0.0004, 0.0), (0.0002, -0.0003), (0.0015, 0.0), (-0.0015, 0.0))
    street = '<tag k="highway" v="residential"/>'
    return _extract(
        [(BERLIN[0] + north, BERLIN[1] + along) for north, along in nodes],
        [((1, 2, 3, 4, 1), f'{street}<tag k="junction" v="roundabout"/>'), ((3, 5), street), ((6, 1), street)],
    )


def grid(streets: int = 4) -> str:
    """Streets from west to east and from south to north, 110 m apart."""
    nodes = [
        (BERLIN[0] + 0.0010 * row, BERLIN[1] + 0.0016 * column) for row in range(streets) for column in range(streets)
    ]
    rows = [range(1 + row * streets, 1 + (row + 1) * streets) for row in range(streets)]
    columns = [range(1 + column, 1 + streets * streets, streets) for column in range(streets)]
    return _extract(nodes, [(way, '<tag k="highway" v="residential"/>') for way in (*rows, *columns)])


def _extract(nodes: Sequence[tuple[float, float]], ways: Sequence[tuple[Sequence[int], str]]) -> str:
    """OSM XML of nodes (latitude, longitude), numbered from 1, and ways, numbered from 10, with their tags."""
    points = (f'<node id="{id_}" lat="{lat:.4f}" lon="{lon:.4f}"/>' for id_, (lat, lon) in enumerate(nodes, start=1))
    roads = (
        f'<way id="{id_}">{"".join(f"""<nd ref="{node}"/>""" for node in members)}{tags}</way>'
        for id_, (members, tags) in enumerate(ways, start=10)
    )
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', '<osm version="0.6">', *points, *roads, "</osm>", ""])


def as_pbf(extract: Path) -> Path:
    """Writes an extract beside itself as .osm.pbf, and returns its path."""
    osmium = pytest.importorskip("osmium")
    packed = extract.with_suffix(".osm.pbf")
    with osmium.SimpleWriter(str(packed), overwrite=True) as writer:
        for one in osmium.FileProcessor(str(extract)):
            writer.add(one)
    return packed
