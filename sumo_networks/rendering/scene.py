"""Scene: numba kernels that draw actors with their shadows, buildings and fixtures."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import FloatArray, IntArray
from dohyo.sumo_networks.rendering.perspective import NEAR_M, Canvas, Haze, block, facade, face, frame_of, point, shadow

HEAD_LOW_M, HEAD_HIGH_M = 4.0, 5.6
LAMP_TOP_M, LAMP_STEP_M, LAMP_RADIUS_M = 5.3, 0.5, 0.22
SIGN_M, SIGN_RADIUS_M = 2.43, 0.46


@njit(cache=True, error_model="numpy")
def draw_shadows(
    canvas: Canvas, bodies: FloatArray, heights: FloatArray, sun: FloatArray, strength: float, haze: Haze
) -> None:
    """Draws the shadows of bodies: soft under them, and to the side away from the sun.

    Args:
        canvas: Image to draw into.
        bodies: (N, 5) x, y [m], heading [rad], length, width [m].
        heights: (N,) heights, m.
        sun: (2,) vector of a shadow per metre of height, m, network frame.
        strength: Share of the light that comes from the sun.
        haze: The fog before the ground.
    """
    frame, polygon, slope = canvas.scratch[4], canvas.scratch[5], math.hypot(sun[0], sun[1])
    for i in range(bodies.shape[0]):
        frame_of(bodies[i, 0], bodies[i, 1], bodies[i, 2], canvas.ego, canvas.mount, frame)
        a, b = bodies[i, 3] / 2, bodies[i, 4] / 2
        if frame[0, 0] + a + b < NEAR_M or _farther(frame, canvas.range_m + a + b + slope * heights[i]):
            continue
        _rectangle(frame, a + 0.12, b + 0.12, polygon)
        shadow(canvas, polygon, 4, 0.32, haze)
        if strength > 0.05:
            c, s = math.cos(bodies[i, 2]), math.sin(bodies[i, 2])
            reach = heights[i]
            u, v = (c * sun[0] + s * sun[1]) * reach, (c * sun[1] - s * sun[0]) * reach
            count = _swept(frame, a, b, u, v, polygon)
            shadow(canvas, polygon, count, 0.42 * strength, haze)


@njit(cache=True, error_model="numpy")
def _farther(frame: FloatArray, distance_m: float) -> bool:
    """Whether the origin of a frame from `frame_of` is farther than a distance from the camera."""
    x, y, z = frame[0, 0], frame[0, 1], frame[0, 2]
    return bool(x * x + y * y + z * z > distance_m * distance_m)


@njit(cache=True, error_model="numpy")
def _rectangle(frame: FloatArray, a: float, b: float, polygon: FloatArray) -> None:
    point(frame, -a, -b, 0.0, polygon[0])
    point(frame, a, -b, 0.0, polygon[1])
    point(frame, a, b, 0.0, polygon[2])
    point(frame, -a, b, 0.0, polygon[3])


@njit(cache=True, error_model="numpy")
def _swept(frame: FloatArray, a: float, b: float, u: float, v: float, polygon: FloatArray) -> int:
    """Convex hull of a rectangle and of the same rectangle moved by (u, v)."""
    count = 0
    for i in range(4):
        x = a if i == 1 or i == 2 else -a
        y = b if i >= 2 else -b
        # The edges before and after this corner face south, east, north and west in turn.
        before = u if i == 2 else (-u if i == 0 else (v if i == 3 else -v))
        after = u if i == 1 else (-u if i == 3 else (v if i == 2 else -v))
        if before <= 0.0 or after <= 0.0:
            if before > 0.0 and after <= 0.0:
                point(frame, x + u, y + v, 0.0, polygon[count])
                count += 1
            point(frame, x, y, 0.0, polygon[count])
            count += 1
        if after > 0.0:
            point(frame, x + u, y + v, 0.0, polygon[count])
            count += 1
    return count


class Bodies(NamedTuple):
    """N actors to draw.

    Attributes:
        boxes: (N, 5) x, y [m], heading [rad], length, width [m].
        kind: (N,) ActorKind.
        indicator: (N,) turn indicator: 1 left, -1 right, 0 off.
        colours: (N, 3) colour of each actor.
        heights: (N,) heights, m.
    """

    boxes: FloatArray
    kind: IntArray
    indicator: IntArray
    colours: IntArray
    heights: FloatArray


class Models(NamedTuple):
    """Models of each kind of actor.

    Attributes:
        labels: (9,) labels by kind.
        parts: (P, 12) parts, see `bodies`.
        start: (10,) first part of each kind.
        paints: (15, 3) colours by Paint.
    """

    labels: NDArray[np.uint8]
    parts: FloatArray
    start: IntArray
    paints: IntArray


@njit(cache=True, error_model="numpy")
def draw_bodies(canvas: Canvas, bodies: Bodies, models: Models, coloured: bool) -> None:
    """Draws actors part by part; small parts only if they are bigger than a pixel.

    Args:
        canvas: Image to draw into.
        bodies: The actors.
        models: Models of the actors.
        coloured: Whether to draw colours instead of labels.
    """
    ego, mount, lens, scratch = canvas.ego, canvas.mount, canvas.lens, canvas.scratch
    boxes, kind, indicator = bodies.boxes, bodies.kind, bodies.indicator
    parts = models.parts
    frame, box, side, top = scratch[4], np.empty(9), np.empty(3), np.empty(3)
    slope_u, slope_v = lens[1] / lens[0], lens[2] / lens[0]
    for i in range(boxes.shape[0]):
        frame_of(boxes[i, 0], boxes[i, 1], boxes[i, 2], ego, mount, frame)
        half_length, half_width = boxes[i, 3] / 2, boxes[i, 4] / 2
        reach = math.sqrt(half_length * half_length + half_width * half_width + bodies.heights[i] * bodies.heights[i])
        depth = frame[0, 0]
        # Skip an actor whose bounding sphere is wholly outside the view: too far, behind, to the side, above or below.
        if _farther(frame, canvas.range_m + reach):
            continue
        if depth + reach < NEAR_M or abs(frame[0, 1]) - depth * slope_u > reach * math.sqrt(1.0 + slope_u * slope_u):
            continue
        if abs(frame[0, 2]) - depth * slope_v > reach * math.sqrt(1.0 + slope_v * slope_v):
            continue
        near = lens[0] * 0.25 > max(depth - reach, 0.0)
        label = -1 if coloured else int(models.labels[kind[i]])
        for row in range(models.start[kind[i]], models.start[kind[i] + 1]):
            when = int(parts[row, 11])
            if (when & 1 and not near) or (when & 16 and not coloured):
                continue
            if (when & 2 and indicator[i] != 1) or (when & 4 and indicator[i] != -1):
                continue
            for k in range(9):
                box[k] = parts[row, k]
            box[0], box[1] = box[0] * half_length, box[1] * half_length
            box[6], box[7] = box[6] * half_length, box[7] * half_length
            box[2], box[3] = box[2] * half_width, box[3] * half_width
            own, above = int(parts[row, 9]), int(parts[row, 10])
            for k in range(3):
                side[k] = bodies.colours[i, k] if own == 0 else models.paints[own, k]
                top[k] = bodies.colours[i, k] if above == 0 else models.paints[above, k]
            block(canvas, frame, box, side, top, 2 if when & 8 else 0, label)


@njit(cache=True, error_model="numpy")
def draw_buildings(canvas: Canvas, buildings: FloatArray, facades: FloatArray, label: int, night: float) -> None:
    """Draws buildings with their windows; nearest first would be faster, but any order gives the same picture.

    Args:
        canvas: Image to draw into.
        buildings: (B, 7) from `buildings_near`.
        facades: (F, 3) colours of walls.
        label: As of `face`.
        night: Share of lit windows.
    """
    ego, mount, lens, range_m, scratch = canvas.ego, canvas.mount, canvas.lens, canvas.range_m, canvas.scratch
    frame, corners, polygon, colour = scratch[4], scratch[5], scratch[6], np.empty(3)
    slope_u = lens[1] / lens[0]
    for i in range(buildings.shape[0]):
        a, b, height = buildings[i, 3] / 2, buildings[i, 4] / 2, buildings[i, 5]
        dx, dy = buildings[i, 0] - ego[0], buildings[i, 1] - ego[1]
        reach = a + b
        if dx * dx + dy * dy > (range_m + reach) ** 2:
            continue
        frame_of(buildings[i, 0], buildings[i, 1], buildings[i, 2], ego, mount, frame)
        high = reach + height
        if frame[0, 0] + high < NEAR_M or abs(frame[0, 1]) - frame[0, 0] * slope_u > high * math.sqrt(
            1.0 + slope_u * slope_u
        ):
            continue
        _rectangle(frame, a, b, corners)
        for k in range(3):
            colour[k] = facades[int(buildings[i, 6] * facades.shape[0]), k]
            for c in range(4):
                corners[4 + c, k] = corners[c, k] + height * frame[3, k]
        seed = int(buildings[i, 6] * 1e6)
        for wall in range(4):
            follows = (wall + 1) & 3
            polygon[0, :], polygon[1, :] = corners[wall, :], corners[follows, :]
            polygon[2, :], polygon[3, :] = corners[4 + follows, :], corners[4 + wall, :]
            facade(canvas, polygon, colour, label, seed + wall, night)
        for c in range(4):
            polygon[c, :] = corners[4 + c, :]
        colour *= 0.6
        face(canvas, polygon, 4, colour, 0, label)


@njit(cache=True, error_model="numpy")
def draw_fixtures(
    canvas: Canvas, heads: FloatArray, states: IntArray, wires: FloatArray, signs: FloatArray, semantic: bool
) -> None:
    """Draws traffic-light heads with their lamps and wires, and stop signs.

    Args:
        canvas: Image to draw into.
        heads: (H, 3) x, y [m], direction of the traffic [rad].
        states: (H,) LightState of each head.
        wires: (W, 4) both ends, m.
        signs: (S, 3) as `heads`.
        semantic: Whether to draw labels instead of colours.
    """
    ego, mount, range_m, scratch = canvas.ego, canvas.mount, canvas.range_m, canvas.scratch
    frame, polygon, box, grey = scratch[4], scratch[5], np.empty(9), np.array([52.0, 55.0, 60.0])
    pole, sign = (8, 9) if semantic else (-1, -1)
    for i in range(heads.shape[0]):
        if math.hypot(heads[i, 0] - ego[0], heads[i, 1] - ego[1]) > range_m:
            continue
        frame_of(heads[i, 0], heads[i, 1], heads[i, 2], ego, mount, frame)
        if frame[0, 0] < -2.0:
            continue
        label = 15 + states[i] if semantic else -1
        box[:] = (-0.12, 0.3, -0.34, 0.34, HEAD_LOW_M, HEAD_HIGH_M, -0.12, 0.3, 1.0)
        block(canvas, frame, box, grey, grey, 0, pole)
        _panel(frame, -0.125, 0.34, HEAD_LOW_M, HEAD_HIGH_M, polygon)
        face(canvas, polygon, 4, np.array([34.0, 36.0, 40.0]), 0, label)
        for lamp in range(3):
            _disc(frame, -0.135, LAMP_TOP_M - LAMP_STEP_M * lamp, LAMP_RADIUS_M, polygon)
            on = states[i] == lamp + 1
            face(canvas, polygon, 8, _LAMPS[lamp + (0 if on else 3)], 2 if on else 0, label)
    for i in range(wires.shape[0]):
        x, y = 0.5 * (wires[i, 0] + wires[i, 2]), 0.5 * (wires[i, 1] + wires[i, 3])
        if math.hypot(x - ego[0], y - ego[1]) > range_m:
            continue
        across = math.hypot(wires[i, 2] - wires[i, 0], wires[i, 3] - wires[i, 1]) / 2
        frame_of(x, y, math.atan2(wires[i, 3] - wires[i, 1], wires[i, 2] - wires[i, 0]), ego, mount, frame)
        box[:] = (-across, across, 0.0, 0.08, HEAD_HIGH_M, HEAD_HIGH_M + 0.1, -across, across, 1.0)
        block(canvas, frame, box, grey, grey, 0, pole)
    for i in range(signs.shape[0]):
        if math.hypot(signs[i, 0] - ego[0], signs[i, 1] - ego[1]) > range_m:
            continue
        frame_of(signs[i, 0], signs[i, 1], signs[i, 2], ego, mount, frame)
        box[:] = (0.0, 0.08, -0.04, 0.04, 0.0, 2.2, 0.0, 0.08, 1.0)
        block(canvas, frame, box, grey, grey, 0, pole)
        for ring in range(2):
            _disc(frame, -0.02 - 0.005 * ring, SIGN_M, SIGN_RADIUS_M - 0.05 * ring, polygon)
            face(canvas, polygon, 8, _SIGN[0 if ring == 0 else 1], 0, sign)
        _panel(frame, -0.04, 0.3, SIGN_M - 0.07, SIGN_M + 0.07, polygon)
        face(canvas, polygon, 4, _SIGN[0], 0, sign)
        _back(frame, 0.0, SIGN_M, SIGN_RADIUS_M, polygon)
        face(canvas, polygon, 8, grey, 0, pole)


_LAMPS: FloatArray = np.array(
    [[255.0, 46, 34], [255, 190, 30], [40, 240, 120], [78, 26, 26], [78, 62, 24], [22, 64, 40]], dtype=np.float64
)
_SIGN: FloatArray = np.array([[240.0, 240, 236], [196, 30, 34]], dtype=np.float64)


@njit(cache=True, error_model="numpy")
def _panel(frame: FloatArray, x: float, half: float, low: float, high: float, polygon: FloatArray) -> None:
    """A rectangle that faces backwards."""
    point(frame, x, half, low, polygon[0])
    point(frame, x, -half, low, polygon[1])
    point(frame, x, -half, high, polygon[2])
    point(frame, x, half, high, polygon[3])


@njit(cache=True, error_model="numpy")
def _disc(frame: FloatArray, x: float, z: float, radius: float, polygon: FloatArray) -> None:
    """An octagon that faces backwards."""
    for i in range(8):
        angle = (i + 0.5) * math.pi / 4
        point(frame, x, -radius * math.cos(angle), z + radius * math.sin(angle), polygon[i])


@njit(cache=True, error_model="numpy")
def _back(frame: FloatArray, x: float, z: float, radius: float, polygon: FloatArray) -> None:
    """An octagon that faces forwards."""
    for i in range(8):
        angle = (i + 0.5) * math.pi / 4
        point(frame, x, radius * math.cos(angle), z + radius * math.sin(angle), polygon[i])
