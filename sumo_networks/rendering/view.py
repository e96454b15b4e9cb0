"""View: tables that depend on a camera and conditions only, such as every pixel's ray and ground point."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from dohyo.sumo_networks.arrays import Float32Array, FloatArray, IntArray
from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.portable_math import power
from dohyo.sumo_networks.rendering.atmosphere import Atmosphere
from dohyo.sumo_networks.units import SIGHT_M

FINEST_M = 0.05
FINEST_REACH_M = 32.0
LEVELS = 5
MOST_TAPS = 4
SMOOTH_TAPS = 0.6
LONGEST_TAP_M = 12.0


@dataclass(frozen=True)
class Optics:
    """A camera's picture and mounting; see `sensors.camera.CameraConfig`."""

    width: int
    height: int
    fov_deg: float
    x_m: float
    y_m: float
    z_m: float
    yaw_deg: float
    pitch_deg: float
    roll_deg: float


@dataclass(frozen=True)
class Level:
    """Pixels whose ground is taken from tiles of one resolution; see `ground.ground_colours`."""

    metres_per_px: float
    pixel: IntArray
    points: Float32Array
    taps: NDArray[np.int8]
    tone: Float32Array
    corners: FloatArray


@dataclass(frozen=True)
class CameraView:
    """Tables that depend on a camera and conditions only, such as every pixel's ray and ground point.

    Attributes:
        lens: (3,) focal length, cx, cy, px.
        mount: (4, 3) position in the ego frame, axes forward, left and up.
        ray: (H, W) metres along the ray per metre of depth.
        inverse: (H, W) 1 / depth of the ground; 0 for the sky and out of sight.
        sky: (H, W) colour of the sky, 0x00BBGGRR.
        levels: Pixels of the ground by resolution.
        air: Atmosphere of the conditions.
        fog: (D, 2) light, and share of a colour left, per half metre.
    """

    lens: FloatArray
    mount: FloatArray
    ray: Float32Array
    inverse: Float32Array
    sky: NDArray[np.uint32]
    levels: tuple[Level, ...]
    air: Atmosphere
    fog: Float32Array


@lru_cache(maxsize=32)
def view_of(optics: Optics, conditions: Conditions) -> CameraView:
    """Tables of a camera; cached, since every episode makes new sensors."""
    air = Atmosphere.of(conditions)
    focal = optics.width / 2 / math.tan(math.radians(optics.fov_deg) / 2)
    lens = np.array([focal, optics.width / 2, optics.height / 2])
    mount = np.vstack([[optics.x_m, optics.y_m, optics.z_m], _axes(optics)])
    rows, columns = np.mgrid[0 : optics.height, 0 : optics.width] + 0.5
    ray = _rays(lens, mount, rows, columns)
    depth = _ground_depth(mount, ray)
    length = np.linalg.norm(ray, axis=-1)
    seen = depth * length < air.range_m
    inverse = np.where(seen, 1.0 / depth, 0.0)
    distances = np.arange(0.25, SIGHT_M + 2.0, 0.5)
    return CameraView(
        lens=lens,
        mount=np.ascontiguousarray(mount),
        ray=length.astype(np.float32),
        inverse=inverse.astype(np.float32),
        sky=_sky(air, ray[..., 2] / length),
        levels=_levels(air, lens, mount, rows, columns, np.where(seen, depth, np.inf)),
        air=air,
        fog=np.column_stack([air.lit(distances), air.transmission(distances)]).astype(np.float32),
    )


def _axes(optics: Optics) -> FloatArray:
    """(3, 3) axes forward, left and up of a camera, in the ego frame."""
    yaw, pitch, roll = (math.radians(angle) for angle in (optics.yaw_deg, optics.pitch_deg, optics.roll_deg))
    forward = np.array([math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch)])
    level = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    upright = np.cross(forward, level)
    left = math.cos(roll) * level + math.sin(roll) * upright
    return np.array([forward, left, np.cross(forward, left)])


def _rays(lens: FloatArray, mount: FloatArray, rows: FloatArray, columns: FloatArray) -> FloatArray:
    """(..., 3) rays of pixels, ego frame, per metre of depth."""
    focal, cx, cy = (float(one) for one in lens)
    left, up = ((cx - columns) / focal)[..., None], ((cy - rows) / focal)[..., None]
    # No matrix product, whose last bits differ between the kernels for processors with and without AVX-512.
    return np.asarray(mount[1] + left * mount[2] + up * mount[3])


def _ground_depth(mount: FloatArray, ray: FloatArray) -> FloatArray:
    """Depth at which rays meet the ground, m; infinite for rays that miss it."""
    down = -ray[..., 2]
    return np.where(down > 1e-6, mount[0, 2] / np.maximum(down, 1e-6), np.inf)


def _sky(air: Atmosphere, rise: FloatArray) -> NDArray[np.uint32]:
    """(H, W) colours of the sky, from the sine of the angle above the horizon."""
    share = power(np.clip((rise - 0.06) / 0.6, 0.0, 1.0), 0.8)[..., None]
    colour = np.clip(air.horizon * (1.0 - share) + air.zenith * share, 0, 255).astype(np.uint32)
    return np.asarray(colour[..., 0] | (colour[..., 1] << 8) | (colour[..., 2] << 16), dtype=np.uint32)


def _levels(
    air: Atmosphere, lens: FloatArray, mount: FloatArray, rows: FloatArray, columns: FloatArray, depth: FloatArray
) -> tuple[Level, ...]:
    """Pixels of the ground, grouped by the resolution of their tiles."""
    seen = np.isfinite(depth)
    ray = _rays(lens, mount, rows, columns)
    points = mount[0, :2] + ray[..., :2] * np.where(seen, depth, 0.0)[..., None]
    across = np.where(seen, depth, 0.0) / lens[0]
    ends = []
    for half in (-0.5, 0.5):
        there = _rays(lens, mount, rows + half, columns)
        far = np.minimum(_ground_depth(mount, there), 2.0 * air.range_m)
        ends.append(there[..., :2] * far[..., None])
    along = ends[1] - ends[0]
    along *= np.minimum(1.0, LONGEST_TAP_M / np.maximum(np.hypot(along[..., 0], along[..., 1]), 1e-9))[..., None]
    # Powers of two at or below, and at or above; frexp is exact, where log2 differs between processors.
    wanted = np.frexp(np.maximum(across, 1e-9) / FINEST_M)[1] - 1
    # Fine tiles only near the ego, since a camera of many pixels would otherwise need hundreds of them.
    mantissa, exponent = np.frexp(np.maximum(np.hypot(points[..., 0], points[..., 1]), 1e-9) / FINEST_REACH_M)
    coarse = exponent - (mantissa == 0.5)
    number = np.clip(np.maximum(wanted, coarse), 0, LEVELS - 1).astype(int)
    length = np.linalg.norm(ray, axis=-1)
    distance = np.where(seen, depth, 0.0) * length
    left = air.transmission(distance)
    # The flatter the view on a wet road, the more the road mirrors the sky.
    mirror = air.wet * 0.85 * ((1.0 - np.clip(-ray[..., 2] / length, 0.0, 1.0)) ** 2) ** 2
    light = air.lit(distance) * (1.0 - 0.3 * air.wet) * (1.0 - mirror) * left
    haze = mirror * left + (1.0 - left)
    out = []
    for level in range(LEVELS):
        chosen = (seen & (number == level)).reshape(-1)
        if not chosen.any():
            continue
        pixel = np.flatnonzero(chosen)
        metres_per_px = FINEST_M * 2**level
        where = points.reshape(-1, 2)[pixel]
        step = along.reshape(-1, 2)[pixel]
        size = np.hypot(step[:, 0], step[:, 1]) / np.maximum(across.reshape(-1)[pixel], metres_per_px)
        magnified = across.reshape(-1)[pixel] < metres_per_px
        taps = np.clip(np.round(size * np.where(magnified, SMOOTH_TAPS, 1.0)), 1, MOST_TAPS)
        taps[magnified] = -taps[magnified]
        low, high = where.min(axis=0), where.max(axis=0)
        reach = np.abs(step).max(axis=0)
        (x0, y0), (x1, y1) = low - reach, high + reach
        out.append(
            Level(
                metres_per_px=metres_per_px,
                pixel=pixel,
                points=np.column_stack([where, step / np.abs(taps)[:, None]]).astype(np.float32),
                taps=taps.astype(np.int8),
                tone=np.column_stack([light.reshape(-1)[pixel], haze.reshape(-1)[pixel]]).astype(np.float32),
                corners=np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]),
            )
        )
    return tuple(out)
