"""Perspective: numba kernels that project boxes and faces into an image, with a depth test.

A camera's frame is x along its axis, y left, z up. A pixel (row, column) looks along (1, (cx - column - 0.5) / f,
(cy - row - 0.5) / f). `inverse` holds 1 / depth of the nearest face so far, for a depth test pixel by
pixel; `value` holds 0xFFBBGGRR, or a label. Flags FF: 1 the colour is final, 2 it emits light.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import Float32Array, FloatArray, IntArray

NEAR_M = 0.1
FINAL = np.uint32(1 << 24)
SHINES = np.uint32(2 << 24)

Values = NDArray[np.uint32]


class Canvas(NamedTuple):
    """An image to draw into, with its camera and light.

    Attributes:
        value: (H, W) image.
        inverse: (H, W) 1 / depth, 1/m.
        ego: (3,) x, y [m], heading [rad].
        mount: (4, 3) position of the camera in the ego frame, then its axes forward, left and up.
        lens: (3,) focal length, cx, cy, px.
        light: (8,) direction to the sun in the camera frame, the sun's share of the light, the world's up in the camera
            frame, unused.
        range_m: Range of sight, m.
        scratch: (8, 16, 3) working memory for corners.
    """

    value: Values
    inverse: Float32Array
    ego: FloatArray
    mount: FloatArray
    lens: FloatArray
    light: FloatArray
    range_m: float
    scratch: FloatArray


class Haze(NamedTuple):
    """The fog before what is drawn; see `develop.develop_colours`.

    Attributes:
        ray: (H, W) metres along a pixel's ray per metre of depth.
        fog: (D, 2) light, and share of a colour left, per half metre.
        horizon: (3,) colour of fog.
    """

    ray: Float32Array
    fog: Float32Array
    horizon: Float32Array


@njit(cache=True, inline="always")
def pack(red: float, green: float, blue: float) -> np.uint32:
    """0x00BBGGRR of a colour from 0 to 255."""
    r, g, b = min(max(red, 0.0), 255.0), min(max(green, 0.0), 255.0), min(max(blue, 0.0), 255.0)
    return np.uint32(r + 0.5) | (np.uint32(g + 0.5) << np.uint32(8)) | (np.uint32(b + 0.5) << np.uint32(16))


@njit(cache=True, error_model="numpy")
def clip_near(polygon: FloatArray, count: int, out: FloatArray) -> int:
    """Clips a polygon at NEAR_M before the camera; returns the number of corners left (Sutherland-Hodgman)."""
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        inside, next_inside = polygon[i, 0] >= NEAR_M, polygon[j, 0] >= NEAR_M
        if inside:
            out[kept, :] = polygon[i, :]
            kept += 1
        if inside != next_inside:
            t = (NEAR_M - polygon[i, 0]) / (polygon[j, 0] - polygon[i, 0])
            out[kept, 0] = NEAR_M
            out[kept, 1] = polygon[i, 1] + t * (polygon[j, 1] - polygon[i, 1])
            out[kept, 2] = polygon[i, 2] + t * (polygon[j, 2] - polygon[i, 2])
            kept += 1
    return kept


@njit(cache=True, error_model="numpy")
def span(corners: FloatArray, count: int, row: int, columns: int) -> tuple[int, int]:
    """First column, and one past the last, whose middle is inside a convex polygon in a row."""
    y = row + 0.5
    left, right = math.inf, -math.inf
    xa, ya = corners[count - 1, 0], corners[count - 1, 1]
    for i in range(count):
        xb, yb = corners[i, 0], corners[i, 1]
        if (ya <= y) != (yb <= y):
            cut = xa + (y - ya) / (yb - ya) * (xb - xa)
            left, right = min(left, cut), max(right, cut)
        xa, ya = xb, yb
    if right < left:
        return 0, 0
    first = math.ceil(min(max(left - 0.5, 0.0), columns))
    return first, math.ceil(min(max(right - 0.5, 0.0), columns))


@njit(cache=True, error_model="numpy")
def project(
    polygon: FloatArray, count: int, lens: FloatArray, clipped: FloatArray, corners: FloatArray
) -> tuple[int, float, float]:
    """Projects the corners of a polygon into the image.

    Returns:
        Number of corners (0: nothing before the camera), lowest and highest of their rows.
    """
    focal, cx, cy = lens[0], lens[1], lens[2]
    kept = clip_near(polygon, count, clipped)
    if kept < 3:
        return 0, 0.0, 0.0
    low, high = math.inf, -math.inf
    for i in range(kept):
        scale = focal / clipped[i, 0]
        corners[i, 0] = cx - scale * clipped[i, 1]
        corners[i, 1] = cy - scale * clipped[i, 2]
        low, high = min(low, corners[i, 1]), max(high, corners[i, 1])
    return kept, low, high


@njit(cache=True, error_model="numpy")
def plane(polygon: FloatArray) -> tuple[float, float, float, float]:
    """Outward unit normal of a face and its distance; the distance is negative if the outside is visible."""
    ax, ay, az = polygon[1, 0] - polygon[0, 0], polygon[1, 1] - polygon[0, 1], polygon[1, 2] - polygon[0, 2]
    bx, by, bz = polygon[2, 0] - polygon[0, 0], polygon[2, 1] - polygon[0, 1], polygon[2, 2] - polygon[0, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    norm = math.sqrt(nx * nx + ny * ny + nz * nz)
    if norm < 1e-12:
        return 0.0, 0.0, 0.0, 0.0
    nx, ny, nz = nx / norm, ny / norm, nz / norm
    return nx, ny, nz, nx * polygon[0, 0] + ny * polygon[0, 1] + nz * polygon[0, 2]


@njit(cache=True, error_model="numpy")
def face(canvas: Canvas, polygon: FloatArray, count: int, colour: FloatArray, flags: int, label: int) -> None:
    """Draws one convex face, seen from outside (corners counter-clockwise), with a depth test.

    Args:
        canvas: Image to draw into.
        polygon: (N, 3) corners, m, camera frame.
        count: Number of corners used.
        colour: (3,) 0 to 255.
        flags: Flags of the value.
        label: Label to write instead of the colour; negative: write the colour.
    """
    value, inverse, lens, light, scratch = canvas.value, canvas.inverse, canvas.lens, canvas.light, canvas.scratch
    nx, ny, nz, distance = plane(polygon)
    if distance >= -1e-9:
        return
    rows, columns = value.shape
    corners = scratch[1]
    kept, low, high = project(polygon, count, lens, scratch[0], corners)
    if kept == 0:
        return
    if label >= 0:
        paint = np.uint32(label)
    else:
        shade = 1.0
        if (flags & 2) == 0:
            sun = max(nx * light[0] + ny * light[1] + nz * light[2], 0.0)
            up = nx * light[4] + ny * light[5] + nz * light[6]
            shade = 0.74 + 0.16 * up + light[3] * (0.34 * sun - 0.12)
        paint = pack(colour[0] * shade, colour[1] * shade, colour[2] * shade) | (np.uint32(flags) << np.uint32(24))
    focal, cx, cy = lens[0], lens[1], lens[2]
    along_u, along_v = -ny / (focal * distance), -nz / (focal * distance)
    at_zero = (nx + ny * cx / focal + nz * cy / focal) / distance
    for row in range(max(math.ceil(low - 0.5), 0), min(math.ceil(high - 0.5), rows)):
        first, last = span(corners, kept, row, columns)
        here = at_zero + along_v * (row + 0.5) + along_u * 0.5
        for column in range(first, last):
            near = np.float32(here + along_u * column)
            if near > inverse[row, column]:
                inverse[row, column] = near
                value[row, column] = paint


@njit(cache=True, error_model="numpy")
def facade(canvas: Canvas, polygon: FloatArray, colour: FloatArray, label: int, seed: int, night: float) -> None:
    """Draws one wall of a building as `face`, with rows of windows; some are lit in the dark.

    Args:
        canvas: Image to draw into.
        polygon: (4, 3) corners, m, camera frame: bottom left, bottom right, top right, top left from outside.
        colour: (3,) colour of the wall.
        label: As of `face`.
        seed: Seed of the choice of lit windows.
        night: Share of lit windows.
    """
    value, inverse, lens, light, scratch = canvas.value, canvas.inverse, canvas.lens, canvas.light, canvas.scratch
    nx, ny, nz, distance = plane(polygon)
    if distance >= -1e-9:
        return
    rows, columns = value.shape
    corners = scratch[1]
    kept, low, high = project(polygon, 4, lens, scratch[0], corners)
    if kept == 0:
        return
    focal, cx, cy = lens[0], lens[1], lens[2]
    sun = max(nx * light[0] + ny * light[1] + nz * light[2], 0.0)
    shade = 0.74 + light[3] * (0.34 * sun - 0.12)
    red, green, blue = colour[0] * shade, colour[1] * shade, colour[2] * shade
    # Axes along the wall, scaled to one per window and one per floor.
    ax, ay, az = polygon[1, 0] - polygon[0, 0], polygon[1, 1] - polygon[0, 1], polygon[1, 2] - polygon[0, 2]
    ux, uy, uz = polygon[3, 0] - polygon[0, 0], polygon[3, 1] - polygon[0, 1], polygon[3, 2] - polygon[0, 2]
    width, height = math.sqrt(ax * ax + ay * ay + az * az), math.sqrt(ux * ux + uy * uy + uz * uz)
    bays, floors = max(round(width / 3.0), 1), max(round((height - 0.8) / 3.1), 1)
    storey = (height - 0.8) / floors
    k, m = bays / (width * width), 1.0 / (storey * height)
    ax, ay, az, ux, uy, uz = ax * k, ay * k, az * k, ux * m, uy * m, uz * m
    a0 = polygon[0, 0] * ax + polygon[0, 1] * ay + polygon[0, 2] * az
    u0 = polygon[0, 0] * ux + polygon[0, 1] * uy + polygon[0, 2] * uz
    along_u, along_v = -ny / (focal * distance), -nz / (focal * distance)
    at_zero = (nx + ny * cx / focal + nz * cy / focal) / distance
    for row in range(max(math.ceil(low - 0.5), 0), min(math.ceil(high - 0.5), rows)):
        first, last = span(corners, kept, row, columns)
        here = at_zero + along_v * (row + 0.5) + along_u * 0.5
        dz = (cy - row - 0.5) / focal
        for column in range(first, last):
            near = here + along_u * column
            if np.float32(near) <= inverse[row, column]:
                continue
            inverse[row, column] = np.float32(near)
            if label >= 0:
                value[row, column] = np.uint32(label)
                continue
            dy = (cx - column - 0.5) / focal
            depth = 1.0 / near
            s = (ax + ay * dy + az * dz) * depth - a0
            t = (ux + uy * dy + uz * dz) * depth - u0
            bay, floor = math.floor(s), math.floor(t)
            fs, ft = s - bay, t - floor
            # Share of the pixel that is window: a box filter as wide as the pixel, along the wall and in height.
            blur_s = max(depth / focal * bays / width * (1.0 + 2.0 * abs(ay)), 0.02)
            blur_t = max(depth / (focal * storey), 0.02)
            inside_s = min(max((min(fs - 0.24, 0.76 - fs)) / blur_s + 0.5, 0.0), 1.0)
            inside_t = min(max((min(ft - 0.30, 0.80 - ft)) / blur_t + 0.5, 0.0), 1.0)
            if blur_s > 0.5:
                inside_s += (0.52 - inside_s) * min((blur_s - 0.5) * 2.0, 1.0)
            if blur_t > 0.5:
                inside_t += (0.50 - inside_t) * min((blur_t - 0.5) * 2.0, 1.0)
            cover = inside_s * inside_t if t < floors else 0.0
            base = 0.86 if t >= floors else (0.93 if t < 0.14 else 1.0)
            mixed = (bay * 73856093) ^ (floor * 19349663) ^ (seed * 83492791)
            lit = night > 0.0 and ((mixed >> 3) & 255) < 255.0 * night
            if lit and cover > 0.45:
                value[row, column] = pack(255.0, 214.0, 138.0) | SHINES
            else:
                glass = 0.35 + 0.25 * ft
                value[row, column] = pack(
                    base * red * (1.0 - cover) + cover * (70.0 + 60.0 * glass) * shade,
                    base * green * (1.0 - cover) + cover * (84.0 + 70.0 * glass) * shade,
                    base * blue * (1.0 - cover) + cover * (98.0 + 84.0 * glass) * shade,
                )


@njit(cache=True, error_model="numpy")
def shadow(canvas: Canvas, polygon: FloatArray, count: int, strength: float, haze: Haze) -> None:
    """Darkens the ground inside a polygon, but not the fog before it; no body may be drawn yet."""
    value, inverse, scratch, horizon = canvas.value, canvas.inverse, canvas.scratch, haze.horizon
    rows, columns = value.shape
    corners = scratch[1]
    kept, low, high = project(polygon, count, canvas.lens, scratch[0], corners)
    if kept == 0:
        return
    keep = 1.0 - strength
    for row in range(max(math.ceil(low - 0.5), 0), min(math.ceil(high - 0.5), rows)):
        first, last = span(corners, kept, row, columns)
        for column in range(first, last):
            near, old = inverse[row, column], value[row, column]
            if near <= 0.0:
                continue
            white = strength * (1.0 - haze.fog[int(haze.ray[row, column] / near * 2.0), 1])
            red = (old & 255) * keep + white * horizon[0]
            green = ((old >> 8) & 255) * keep + white * horizon[1]
            blue = ((old >> 16) & 255) * keep + white * horizon[2]
            value[row, column] = pack(red, green, blue) | FINAL


@njit(cache=True, error_model="numpy")
def frame_of(x: float, y: float, heading: float, ego: FloatArray, mount: FloatArray, out: FloatArray) -> None:
    """Computes a body's origin on the ground and its axes, in the camera frame.

    Args:
        x: x of the origin, m, network frame.
        y: y of the origin, m, network frame.
        heading: Heading of the body, rad.
        ego: (3,) x, y [m], heading [rad] of the ego.
        mount: (4, 3) position of the camera in the ego frame, then its axes forward, left and up.
        out: (4, 3) output: origin, then the axes forward, left and up.
    """
    cos, sin = math.cos(ego[2]), math.sin(ego[2])
    dx, dy = x - ego[0], y - ego[1]
    px, py, pz = dx * cos + dy * sin - mount[0, 0], dy * cos - dx * sin - mount[0, 1], -mount[0, 2]
    turned = heading - ego[2]
    c, s = math.cos(turned), math.sin(turned)
    for i in range(3):
        a, b, up = mount[1 + i, 0], mount[1 + i, 1], mount[1 + i, 2]
        out[0, i] = px * a + py * b + pz * up
        out[1, i] = c * a + s * b
        out[2, i] = c * b - s * a
        out[3, i] = up


@njit(cache=True, error_model="numpy")
def point(frame: FloatArray, x: float, y: float, z: float, out: FloatArray) -> None:
    """Transforms a point of a body into the camera frame."""
    for i in range(3):
        out[i] = frame[0, i] + x * frame[1, i] + y * frame[2, i] + z * frame[3, i]


@njit(cache=True, error_model="numpy")
def block(
    canvas: Canvas, frame: FloatArray, box: FloatArray, side: FloatArray, top: FloatArray, flags: int, label: int
) -> None:
    """Draws a box whose top may be smaller than its bottom.

    Args:
        canvas: Image to draw into.
        frame: Frame of the body, from `frame_of`.
        box: (9,) x from, x to, y from, y to, z from, z to, x from at the top, x to at the top, share of the width
            there; m, body frame.
        side: (3,) colour of the sides.
        top: (3,) colour of the top.
        flags: As of `face`.
        label: As of `face`.
    """
    corners, polygon = canvas.scratch[2], canvas.scratch[3]
    x0, x1, y0, y1, z0, z1, u0, u1, share = box[0], box[1], box[2], box[3], box[4], box[5], box[6], box[7], box[8]
    middle = 0.5 * (y0 + y1) * (1.0 - share)
    v0, v1 = middle + y0 * share, middle + y1 * share
    point(frame, x0, y0, z0, corners[0])
    point(frame, x1, y0, z0, corners[1])
    point(frame, x1, y1, z0, corners[2])
    point(frame, x0, y1, z0, corners[3])
    point(frame, u0, v0, z1, corners[4])
    point(frame, u1, v0, z1, corners[5])
    point(frame, u1, v1, z1, corners[6])
    point(frame, u0, v1, z1, corners[7])
    farthest = corners[0, 0]
    for i in range(1, 8):
        farthest = max(farthest, corners[i, 0])
    if farthest < NEAR_M:
        return
    # The camera's place in the body's frame decides which sides of a plain box are hidden.
    ex, ey, ez = 0.0, 0.0, 0.0
    for i in range(3):
        ex -= frame[0, i] * frame[1, i]
        ey -= frame[0, i] * frame[2, i]
        ez -= frame[0, i] * frame[3, i]
    plain = x0 == u0 and x1 == u1 and share == 1.0
    for number in range(6):
        if (number == 0 and ez <= z1) or (number == 1 and ez >= z0):
            continue
        if plain and (
            (number == 2 and ey >= y0)
            or (number == 3 and ey <= y1)
            or (number == 4 and ex <= x1)
            or (number == 5 and ex >= x0)
        ):
            continue
        for i in range(4):
            polygon[i, :] = corners[_FACES[number, i], :]
        face(canvas, polygon, 4, top if number == 0 else side, flags, label)


_FACES: IntArray = np.array(
    [[4, 5, 6, 7], [3, 2, 1, 0], [0, 1, 5, 4], [2, 3, 7, 6], [1, 2, 6, 5], [3, 0, 4, 7]], dtype=np.int64
)
