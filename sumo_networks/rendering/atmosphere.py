"""Atmosphere: the effects of conditions on light, air and lens; and the colours of the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.conditions import Conditions
from dohyo.sumo_networks.portable_math import exp
from dohyo.sumo_networks.rendering.surfaces import Surface
from dohyo.sumo_networks.units import SIGHT_M

_GROUND = {
    Surface.TERRAIN: (141, 154, 108),
    Surface.ROAD: (88, 90, 95),
    Surface.LINE: (236, 236, 230),
    Surface.STOP_LINE: (240, 240, 236),
    Surface.CROSSING: (88, 90, 95),
    Surface.STRIPE: (238, 238, 232),
    Surface.SIDEWALK: (176, 172, 166),
    Surface.KERB: (206, 203, 196),
    Surface.CYCLEWAY: (150, 92, 84),
    Surface.TRACK: (128, 120, 110),
}
GROUND_COLOURS: tuple[tuple[int, int, int], ...] = tuple(_GROUND[surface] for surface in Surface)
"""(10, 3) colours by Surface, in daylight."""

FACADES: FloatArray = np.array(
    [
        (222, 211, 190),
        (205, 186, 158),
        (196, 160, 132),
        (214, 206, 198),
        (186, 192, 196),
        (176, 132, 112),
        (228, 220, 204),
        (190, 182, 160),
    ],
    dtype=np.float64,
)


@dataclass(frozen=True)
class Atmosphere:
    """Light, air and lens; colours are from 0 to 255, shares from 0 to 1.

    Attributes:
        range_m: Range of sight, m.
        zenith: (3,) colour of the sky above.
        horizon: (3,) colour of the sky at the horizon, and of fog.
        tint: (3,) factor on every colour, the light's brightness included.
        sun: Share of the light that comes from the sun.
        lamps: Brightness of near objects in the ego's head lamps.
        wet: Strength of the road's reflection.
        noise: Standard deviation of a pixel's noise, in levels of 255.
        rain: Number of rain streaks per thousand pixels.
    """

    range_m: float
    zenith: FloatArray
    horizon: FloatArray
    tint: FloatArray
    sun: float
    lamps: float
    wet: float
    noise: float
    rain: float

    @classmethod
    def of(cls, conditions: Conditions) -> Atmosphere:
        """Atmosphere of conditions.

        Conditions have no rain: a road with less grip is drawn wet, and rain is drawn if the visibility is below 100 m.
        """
        dark = 1.0 - conditions.daylight
        wet = float(np.clip((1.0 - conditions.friction) / 0.4, 0.0, 1.0))
        rain = float(np.clip((SIGHT_M - conditions.visibility_m) / 50.0, 0.0, 1.0))
        clouds = max(rain, 0.55 * wet)
        low_sun = float(np.clip(1.6 * dark, 0.0, 1.0)) * (1.0 - 0.75 * rain)
        light = 0.16 + 0.84 * conditions.daylight**0.85
        light *= 1.0 - 0.18 * clouds
        tint = light * _mix((1.0, 1.0, 1.0), (1.1, 0.93, 0.82), low_sun)
        day_zenith = _mix((92, 148, 214), (150, 160, 170), clouds)
        day_horizon = _mix((206, 222, 234), (186, 192, 197), clouds)
        return cls(
            range_m=min(conditions.visibility_m, SIGHT_M),
            zenith=_mix(day_zenith, (58, 62, 96), low_sun) * (0.35 + 0.65 * conditions.daylight**0.5),
            horizon=_mix(day_horizon, (238, 164, 112), low_sun * (1.0 - 0.5 * clouds))
            * (0.42 + 0.58 * conditions.daylight**0.7),
            tint=tint,
            sun=0.9 * (1.0 - clouds),
            lamps=0.85 * max(dark - 0.25, 0.0),
            wet=wet,
            noise=2.0 * max(dark - 0.3, 0.0) + 3.0 * rain,
            rain=3.0 * rain,
        )

    def transmission(self, distance: FloatArray) -> FloatArray:
        """Share of a colour that remains at a distance [m]; the rest is fog. 1 near, 0 at `range_m` and beyond.

        It falls with the fourth power of the distance, so that the near half stays clear on a clear day although the
        world ends at 100 m.
        """
        share = np.clip(distance / self.range_m, 0.0, 1.0)
        end = math.exp(-3.0)
        return np.asarray((exp(-3.0 * (share**2) ** 2) - end) / (1.0 - end))

    def lit(self, distance: FloatArray) -> FloatArray:
        """Factor of the head lamps on colours, by distance [m]; applied before `tint`."""
        return np.asarray(1.0 + self.lamps * 2.4 * exp(-distance / 16.0))


def _mix(a: FloatArray | tuple[float, ...], b: FloatArray | tuple[float, ...], share: float) -> FloatArray:
    return np.asarray(a, dtype=np.float64) * (1.0 - share) + np.asarray(b, dtype=np.float64) * share
