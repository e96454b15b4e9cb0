"""Numba kernels of plane geometry: box overlap, projection, segment crossing, nearest lanes.

Boxes are rows of x, y [m], heading [rad], length, width [m]; all in the network frame unless said otherwise.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dohyo.sumo_networks.arrays import BoolArray, FloatArray, IntArray

NEAR_M = 30.0


def wrap_angle(angle: FloatArray | float) -> FloatArray:
    """Angle brought into [-pi, pi), rad."""
    return np.asarray((np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi)


@njit(cache=True)
def wrap(angle: float) -> float:
    """Scalar angle brought into [-pi, pi), rad."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@njit(cache=True)
def _separated(a: FloatArray, b: FloatArray) -> bool:
    """Whether one of the axes of box a separates it from box b."""
    cos_a, sin_a = math.cos(a[2]), math.sin(a[2])
    cos_d, sin_d = abs(math.cos(b[2] - a[2])), abs(math.sin(b[2] - a[2]))
    dx, dy = b[0] - a[0], b[1] - a[1]
    along = abs(dx * cos_a + dy * sin_a)
    across = abs(-dx * sin_a + dy * cos_a)
    reach = 0.5 * (a[3] + b[3] * cos_d + b[4] * sin_d)
    reach_across = 0.5 * (a[4] + b[3] * sin_d + b[4] * cos_d)
    return bool(along > reach or across > reach_across)


@njit(cache=True)
def box_overlaps(a: FloatArray, b: FloatArray) -> bool:
    """Separating-axis test of two oriented boxes (5,): whether the closed boxes share a point."""
    reach = 0.5 * (a[3] + a[4] + b[3] + b[4])
    if abs(a[0] - b[0]) > reach or abs(a[1] - b[1]) > reach:
        return False
    return not (_separated(a, b) or _separated(b, a))


@njit(cache=True)
def boxes_overlap(a: FloatArray, b: FloatArray) -> BoolArray:
    """Separating-axis test of oriented boxes, pairwise.

    Args:
        a: (N, 5) boxes.
        b: (M, 5) boxes.

    Returns:
        (N, M) whether the closed boxes share a point.
    """
    out = np.zeros((a.shape[0], b.shape[0]), dtype=np.bool_)
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            out[i, j] = box_overlaps(a[i], b[j])
    return out


@njit(cache=True)
def project_on_path(
    x: float, y: float, path: FloatArray, spacing: float, first: int, last: int
) -> tuple[float, float, float]:
    """Projects a point on a window of a polyline of equally spaced points.

    Args:
        x: x of the point, m.
        y: y of the point, m.
        path: (N, 2) points, m.
        spacing: m between consecutive points.
        first: First segment of the window.
        last: One past the last segment of the window.

    Returns:
        Arc length [m], signed distance [m, left positive], direction of the segment [rad].
    """
    best, best_s, best_offset, best_heading = math.inf, 0.0, 0.0, 0.0
    for i in range(max(first, 0), min(last, path.shape[0] - 1)):
        ux, uy = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
        length = math.hypot(ux, uy)
        if length == 0.0:
            continue
        dx, dy = x - path[i, 0], y - path[i, 1]
        t = min(max((dx * ux + dy * uy) / (length * length), 0.0), 1.0)
        distance = math.hypot(dx - t * ux, dy - t * uy)
        if distance < best:
            side = ux * dy - uy * dx
            best = distance
            best_s = (i + t) * spacing
            best_offset = math.copysign(distance, side)
            best_heading = math.atan2(uy, ux)
    return best_s, best_offset, best_heading


SegmentGrid = tuple[FloatArray, IntArray, FloatArray, IntArray, IntArray, FloatArray, float, int, int]
"""Segments of lanes in a uniform grid, for `nearest_lane`. A plain tuple, since numba reads a named one 1 us slower.

    segments: (S, 4) x0, y0, x1, y1 of every lane segment, m; the segments of a lane are consecutive rows.
    segment_lane: (S,) lane of each segment.
    half_width: (L,) half width of each lane, m.
    cells: (rows * columns + 1,) start of each grid cell in `members`.
    members: Rows of `segments`, grouped by grid cell.
    origin: (2,) lower left corner of the grid, m.
    cell: Edge length of a grid cell, m; at least 30.
    columns: Number of columns of the grid.
    rows: Number of rows of the grid.
"""


@njit(cache=True)
def nearest_lane(
    x: float, y: float, heading: float, grid: SegmentGrid, preferred: BoolArray
) -> tuple[int, float, float]:
    """Lane that a vehicle at a point drives on.

    Lanes that contain the point come first; among these, preferred lanes (on the route), then the lane that is best
    aligned with the heading.

    Args:
        x: x of the point, m.
        y: y of the point, m.
        heading: Heading of the vehicle, rad.
        grid: Segments of the lanes.
        preferred: (L,) lanes to prefer.

    Returns:
        Lane index or -1 if none is within 30 m, signed distance to its centreline [m, left positive], heading minus
        lane direction [rad].
    """
    segments, segment_lane, half_width, cells, members, origin, cell, columns, rows = grid
    column = math.floor((x - origin[0]) / cell)
    row = math.floor((y - origin[1]) / cell)
    best, best_segment = math.inf, -1
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        for c in range(max(column - 1, 0), min(column + 2, columns)):
            for k in range(cells[r * columns + c], cells[r * columns + c + 1]):
                i = members[k]
                distance, _ = _to_segment(x, y, segments[i])
                if distance > NEAR_M:
                    continue
                lane = segment_lane[i]
                beside, other = 100.0 * max(distance - half_width[lane], 0.0), 0.0 if preferred[lane] else 2.0
                if beside + 0.1 * distance + other >= best:
                    continue  # the alignment cannot change the result, and costs more to compute
                cost = beside + abs(wrap(heading - _direction(segments[i]))) + 0.1 * distance + other
                if cost < best:
                    best, best_segment = cost, i
    if best_segment < 0:
        return -1, math.nan, math.nan
    # The heading has chosen the lane; the nearest segment of that lane depends on the distance alone.
    lane, i = segment_lane[best_segment], best_segment
    while i > 0 and segment_lane[i - 1] == lane:
        i -= 1
    nearest, offset, nearest_segment = math.inf, math.nan, i
    while i < segments.shape[0] and segment_lane[i] == lane:
        distance, side = _to_segment(x, y, segments[i])
        if distance < nearest:
            nearest, offset, nearest_segment = distance, math.copysign(distance, side), i
        i += 1
    return lane, offset, wrap(heading - _direction(segments[nearest_segment]))


@njit(cache=True)
def _to_segment(x: float, y: float, segment: FloatArray) -> tuple[float, float]:
    """Distance of a point to a segment [m], and a number that is positive on the segment's left side."""
    ux, uy = segment[2] - segment[0], segment[3] - segment[1]
    dx, dy = x - segment[0], y - segment[1]
    t = min(max((dx * ux + dy * uy) / (ux * ux + uy * uy), 0.0), 1.0)
    return math.hypot(dx - t * ux, dy - t * uy), ux * dy - uy * dx


@njit(cache=True)
def _direction(segment: FloatArray) -> float:
    """Direction of a segment, rad."""
    return math.atan2(segment[3] - segment[1], segment[2] - segment[0])


@njit(cache=True)
def crossed_segments(x0: float, y0: float, x1: float, y1: float, lines: FloatArray) -> IntArray:
    """Indices of the lines that a motion crosses from back to front.

    Args:
        x0: Start of the motion, m.
        y0: Start of the motion, m.
        x1: End of the motion, m.
        y1: End of the motion, m.
        lines: (S, 4) right end x, y and left end x, y of each line, m; its front is to the right of right-to-left,
            so that a vehicle driving over a stop line drawn from the right kerb to the left crosses back to front.

    Returns:
        (C,) indices. Touching the line at the end of the motion does not count; starting on it does.
    """
    found = np.empty(lines.shape[0], dtype=np.int64)
    count = 0
    for i in range(lines.shape[0]):
        rx, ry, lx, ly = lines[i, 0], lines[i, 1], lines[i, 2], lines[i, 3]
        wx, wy = lx - rx, ly - ry
        before = wx * (y0 - ry) - wy * (x0 - rx)
        after = wx * (y1 - ry) - wy * (x1 - rx)
        if before < 0.0 or after >= 0.0:
            continue
        mx, my = x1 - x0, y1 - y0
        right = mx * (ry - y0) - my * (rx - x0)
        left = mx * (ly - y0) - my * (lx - x0)
        if right <= 0.0 <= left:
            found[count] = i
            count += 1
    return found[:count]


@njit(cache=True)
def ray_to_box(x: float, y: float, ux: float, uy: float, box: FloatArray) -> float:
    """Distance along a ray to an oriented box (slab test).

    Args:
        x: Start, m.
        y: Start, m.
        ux: Direction, of length 1.
        uy: Direction.
        box: (5,) the box.

    Returns:
        Distance, m; 0 if the ray starts inside the box, infinity if it misses the box.
    """
    cos, sin = math.cos(box[2]), math.sin(box[2])
    dx, dy = x - box[0], y - box[1]
    near, far = 0.0, math.inf
    for axis in range(2):
        start = dx * cos + dy * sin if axis == 0 else dy * cos - dx * sin
        along = ux * cos + uy * sin if axis == 0 else uy * cos - ux * sin
        half = 0.5 * box[3 + axis]
        if abs(along) < 1e-12:
            if abs(start) > half:
                return math.inf
            continue
        first, second = (-half - start) / along, (half - start) / along
        near, far = max(near, min(first, second)), min(far, max(first, second))
    return near if near <= far else math.inf
