"""Rules: what ends a kart's episode, and with which reward. The thesis has two rewards; the judge has its own rules.

A kart that parks gets +1. Every other end gives -1: contact, the time limit, and what the rules below end. Neither
reward of the thesis has a term for collisions; that one is ours.
"""

from __future__ import annotations

import math
from enum import IntEnum
from functools import lru_cache
from typing import Final, Literal

import numpy as np
from pydantic import Field

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.parking.kart import TICK_S

STANDS_BELOW_MPS: Final = 0.1
"""A slower kart stands."""


class Outcome(IntEnum):
    """How the episode of a kart ended; RUNNING: it has not; ABSENT: the lot has no such kart."""

    RUNNING = 0
    PARKED = 1
    COLLIDED = 2
    TIMED_OUT = 3
    REVERSED = 4
    MISALIGNED = 5
    STRAYED = 6
    ABSENT = 7


class Rules(Config):
    """When an episode ends. A kart is *in place* while its centre is within `radius_m` of its spot's centre.

    Contact and the lot's time limit always end it. Contact and the time in place are looked at every 25 ms, the rest
    once per tick of 0.1 s, to which `seconds_s` is rounded.

    Attributes:
        radius_m: See above.
        seconds: What a kart needs to park besides being in place. "dwell": `seconds_s` in place without a break (our
            reading of the thesis's t_p >= 1 s); "elapsed": `seconds_s` since the episode began (the literal reading);
            "none": nothing.
        seconds_s: See `seconds`.
        standing: Whether a kart must also stand (below 0.1 m/s) to park.
        farthest_m: A greater distance from the spot's centre ends the episode as strayed; None: no distance does.
        reversing_ends: Whether a negative motor torque ends the episode.
        wheel_degrees: In place, a larger angle between the front wheels and the spot's direction ends the episode as
            misaligned; None: none does.
        error_degrees: In place, an angle of this size or more between the kart and the spot's direction, forwards, ends
            the episode as misaligned; None: none does.
        progress: Reward per metre by which a kart comes nearer to its spot; the thesis has none. To and fro add up to
            nothing. The sum is kept at the end, so that a kart that fails near its spot gets more than one that fails
            far from it. A change of the spot costs nothing.
        alignment: A parked kart gets this times `kernel.alignment_of` on top, which is 1 where it is aligned exactly.
            The thesis has none.
    """

    radius_m: float = Field(default=0.5, gt=0)
    seconds: Literal["dwell", "elapsed", "none"] = "dwell"
    seconds_s: float = Field(default=1.0, ge=0)
    standing: bool = False
    farthest_m: float | None = Field(default=None, gt=0)
    reversing_ends: bool = False
    wheel_degrees: float | None = Field(default=None, gt=0)
    error_degrees: float | None = Field(default=None, gt=0)
    progress: float = 0.0
    alignment: float = Field(default=0.0, ge=0)

    def row(self) -> FloatArray:
        """(10,) numbers for the kernel, by the columns below; shared, so do not write to it."""
        return _row(self)

    def _numbers(self) -> FloatArray:
        row = np.zeros(WIDTH)
        ticks = round(self.seconds_s / TICK_S)
        row[RADIUS], row[STANDING] = self.radius_m, STANDS_BELOW_MPS if self.standing else math.inf
        row[DWELL_TICKS] = ticks if self.seconds == "dwell" else 0
        row[ELAPSED_TICKS] = ticks if self.seconds == "elapsed" else 0
        row[FARTHEST] = math.inf if self.farthest_m is None else self.farthest_m
        row[REVERSING_ENDS], row[PROGRESS], row[ALIGNMENT] = self.reversing_ends, self.progress, self.alignment
        row[WHEEL] = math.inf if self.wheel_degrees is None else math.radians(self.wheel_degrees)
        row[ERROR] = math.inf if self.error_degrees is None else math.radians(self.error_degrees)
        return row


@lru_cache(maxsize=64)
def _row(rules: Rules) -> FloatArray:
    return rules._numbers()


RADIUS, DWELL_TICKS, ELAPSED_TICKS, STANDING, FARTHEST, REVERSING_ENDS, WHEEL, ERROR, PROGRESS, ALIGNMENT = range(10)
"""Columns of `Rules.row`: m, ticks, ticks, m/s, m, 0 or 1, rad, rad, 1/m, a factor. Where a rule is off there are 0
ticks, or an infinite bound."""
WIDTH: Final = 10
"""Number of these columns."""

JUDGED: Final = Rules(standing=True)
"""Rules of the benchmarks: 1 s in place and then standing, in time, without contact. Alignment ends nothing; it is
measured where the kart has parked."""
SIMPLE: Final = Rules(seconds="none", farthest_m=30.0)
"""First reward of the thesis: -1 beyond 30 m or at the time limit, +1 within 0.5 m."""
ALIGNED: Final = Rules(reversing_ends=True, wheel_degrees=15.0, error_degrees=10.0)
"""Second reward of the thesis: +1 after 1 s in place; -1 for reversing, or a wrong angle. Angles are judged in place,
since a kart on its way points anywhere."""
WITHOUT_DWELL: Final = Rules(seconds="none", reversing_ends=True, wheel_degrees=15.0, error_degrees=10.0)
WITHOUT_ALIGNMENT: Final = Rules(reversing_ends=True)
LITERAL: Final = Rules(seconds="elapsed", reversing_ends=True, wheel_degrees=15.0, error_degrees=10.0)
"""Variants of the second reward. `WITHOUT_DWELL`: no time in place; `WITHOUT_ALIGNMENT`: no angles; `LITERAL`: 1 s
since the beginning in place of the time in place."""

ALIGNED_ANGLE_RAD: Final = math.radians(3.0)
ALIGNED_DEVIATION_M: Final = 0.2
"""A parked kart is aligned within 3 degrees of its spot's axis, either way round, and less than 0.2 m beside it: ISO
16787:2017 as the thesis quotes it."""
