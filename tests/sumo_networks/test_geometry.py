from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.geometry import boxes_overlap, crossed_segments, project_on_path, wrap, wrap_angle

near = st.floats(-8, 8)
angles = st.floats(-10, 10)
boxes = st.tuples(near, near, angles, st.floats(0.1, 12), st.floats(0.1, 4))


def polygon(box: FloatArray) -> shapely.Polygon:
    x, y, heading, length, width = box
    cos, sin = math.cos(heading), math.sin(heading)
    corners = [(a * length / 2, b * width / 2) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return shapely.Polygon([(x + a * cos - b * sin, y + a * sin + b * cos) for a, b in corners])


@given(st.lists(boxes, min_size=1, max_size=5), st.lists(boxes, min_size=1, max_size=5))
def test_boxes_overlap_where_their_polygons_meet(
    first: list[tuple[float, ...]], second: list[tuple[float, ...]]
) -> None:
    a, b = np.array(first), np.array(second)
    overlap = boxes_overlap(a, b)
    assert overlap.shape == (len(a), len(b))
    for i, one in enumerate(map(polygon, a)):
        for j, other in enumerate(map(polygon, b)):
            if one.distance(other) > 1e-9:
                assert not overlap[i, j]
            elif one.intersection(other).area > 1e-9:
                assert overlap[i, j]


@pytest.mark.parametrize(("gap", "meet"), [(0.0, True), (1e-9, False), (-1e-9, True)])
def test_boxes_are_closed(gap: float, meet: bool) -> None:
    a, b = np.array([[0.0, 0.0, 0.0, 4.0, 2.0]]), np.array([[4.0 + gap, 0.0, 0.0, 4.0, 2.0]])
    assert boxes_overlap(a, b)[0, 0] == meet


def test_corner_against_corner_needs_the_axes_of_both_boxes() -> None:
    square = np.array([[0.0, 0.0, 0.0, 2.0, 2.0]])
    # A diamond whose bounding box overlaps the square's, and whose edge passes its corner at a few centimetres.
    apart, touching = ([[x, x, math.pi / 4, 2.0, 2.0]] for x in (1.75, 1.70))
    assert not boxes_overlap(square, np.array(apart))[0, 0]
    assert boxes_overlap(square, np.array(touching))[0, 0]


def test_there_may_be_no_boxes_at_all() -> None:
    assert boxes_overlap(np.empty((0, 5)), np.zeros((3, 5))).shape == (0, 3)


@st.composite
def paths(draw: st.DrawFn) -> FloatArray:
    turns = draw(st.lists(st.floats(-0.6, 0.6), min_size=1, max_size=40))
    headings = np.cumsum(turns)
    return np.vstack([[0.0, 0.0], np.cumsum(np.column_stack([np.cos(headings), np.sin(headings)]), axis=0)])


@given(paths(), near, near)
def test_projection_finds_the_nearest_point_of_the_path(path: FloatArray, x: float, y: float) -> None:
    line, point = shapely.LineString(path), shapely.Point(x, y)
    s, offset, heading = project_on_path(x, y, path, 1.0, 0, len(path) - 1)
    assert abs(offset) == pytest.approx(line.distance(point), abs=1e-9)
    assert line.interpolate(s).distance(point) == pytest.approx(line.distance(point), abs=1e-9)
    i = min(int(s), len(path) - 2)
    directions = [math.atan2(*(path[k + 1] - path[k])[::-1]) for k in (max(i - 1, 0), i, min(i + 1, len(path) - 2))]
    assert min(abs(wrap(heading - direction)) for direction in directions) < 1e-9


@given(paths(), st.floats(0.05, 0.95), st.floats(-0.4, 0.4))
def test_projection_gives_back_arc_length_and_signed_offset(path: FloatArray, share: float, offset: float) -> None:
    at = share * (len(path) - 1)
    i = min(int(at), len(path) - 2)
    along = path[i + 1] - path[i]
    x, y = path[i] + (at - i) * along + offset * np.array([-along[1], along[0]])
    assume(shapely.LineString(path).distance(shapely.Point(x, y)) > abs(offset) - 1e-9)
    s, found, _ = project_on_path(float(x), float(y), path, 1.0, i, i + 1)
    assert s == pytest.approx(at, abs=1e-9)
    assert found == pytest.approx(offset, abs=1e-9)


def test_projection_looks_only_at_its_window() -> None:
    out_and_back = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [20.0, 1.0], [10.0, 1.0], [0.0, 1.0]])
    s, offset, heading = project_on_path(5.0, 0.9, out_and_back, 10.0, 0, 2)
    assert (s, offset, heading) == (5.0, pytest.approx(0.9), 0.0)
    s, offset, heading = project_on_path(5.0, 0.9, out_and_back, 10.0, 3, 5)
    assert s == pytest.approx(45.0)
    assert offset == pytest.approx(0.1)  # on the way back, south is left
    assert abs(heading) == pytest.approx(math.pi)


# A stop line across an eastward lane: from its right end in the south to its left end in the north.
LINE = np.array([[0.0, -2.0, 0.0, 2.0]])


@pytest.mark.parametrize(
    ("motion", "crossed"),
    [
        pytest.param((-1, 0, 1, 0), True, id="straight over it"),
        pytest.param((1, 0, -1, 0), False, id="backwards"),
        pytest.param((-2, 0, -1, 0), False, id="before it"),
        pytest.param((1, 0, 2, 0), False, id="behind it"),
        pytest.param((-1, 3, 1, 3), False, id="past its left end"),
        pytest.param((-1, -3, 1, -3), False, id="past its right end"),
        pytest.param((-1, 1.9, 1, 1.9), True, id="near its left end"),
        pytest.param((-1, -1, 1, 1), True, id="aslant"),
        pytest.param((-1, 0, 1, 10), False, id="aslant past its end"),
        pytest.param((0, 0, 1, 0), True, id="starting on it"),
        pytest.param((-1, 0, 0, 0), False, id="ending on it"),
        pytest.param((0, -1, 0, 1), False, id="along it"),
        pytest.param((0, 0, 0, 0), False, id="standing on it"),
    ],
)
def test_a_line_is_crossed_from_back_to_front(motion: tuple[float, ...], crossed: bool) -> None:
    assert list(crossed_segments(*map(float, motion), LINE)) == [0] * crossed


@given(st.floats(-5, -0.01), near, st.floats(-5, 5), near, angles)
def test_a_motion_in_pieces_crosses_as_often_as_in_one(x0: float, y0: float, x1: float, y1: float, turn: float) -> None:
    cos, sin = math.cos(turn), math.sin(turn)
    rotation = np.array([[cos, sin], [-sin, cos]])
    line = (LINE.reshape(2, 2) @ rotation).reshape(1, 4)
    straight = np.linspace([x0, y0], [x1, y1], 8)
    assume(np.abs(straight[:, 0]).min() > 1e-6)
    points = straight @ rotation
    whole = len(crossed_segments(*points[0], *points[-1], line))
    pieces = sum(len(crossed_segments(*a, *b, line)) for a, b in pairwise(points))
    at_zero = y0 + (y1 - y0) * -x0 / (x1 - x0) if x1 > 0 else math.inf
    assume(abs(abs(at_zero) - 2.0) > 1e-6)
    assert whole == pieces == (abs(at_zero) < 2.0)


def test_all_crossed_lines_are_found_in_order() -> None:
    lines = np.array([[3.0, -1.0, 3.0, 1.0], [9.0, -1.0, 9.0, 1.0], [1.0, -1.0, 1.0, 1.0]])
    assert list(crossed_segments(0.0, 0.0, 5.0, 0.0, lines)) == [0, 2]


@given(st.floats(-1e4, 1e4))
def test_wrapping_keeps_the_direction_and_lies_within_half_a_turn(angle: float) -> None:
    for wrapped in (wrap(angle), float(wrap_angle(angle))):
        assert -math.pi <= wrapped < math.pi
        assert math.cos(wrapped - angle) == pytest.approx(1.0)
