"""Rules: what ends a kart's episode, and with which reward. The thesis has two rewards; the judge has its own rules.

Both rewards of the thesis lack a collision term. A contact ends every episode here with -1, which is ours.
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


class Outcome(IntEnum):
    """How the episode of a kart ended."""

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

    Attributes:
        radius_m: See above.
        seconds: What a parked kart needs besides being in place. "dwell": `seconds_s` in place without a break (our
            reading of the thesis's t_p >= 1 s); "elapsed": `seconds_s` since the episode began (the literal reading);
            "none": nothing.
        seconds_s: See `seconds`.
        standing: Whether a kart must also stand (below 0.1 m/s).
        farthest_m: A kart that is farther from its spot's centre has strayed; None: it may.
        reversing_ends: Whether a negative motor torque ends the episode.
        wheel_degrees: In place, the largest angle between front wheels and spot; None: any.
        error_degrees: In place, a heading error of this size or more ends the episode; None: any.
        progress: Reward per metre by which a kart comes nearer to its spot. The thesis has none; it does not change
            which behaviour is best, since what a kart gains on a way to a spot it loses on the way back.
        alignment: Reward of a parked kart for its alignment, times `kernel.alignment_of`. The thesis has none.
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
        """(10,) numbers for the kernel, which nobody may change."""
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
"""Columns of `Rules.row`; angles in rad."""
WIDTH: Final = 10

JUDGED: Final = Rules(standing=True)
"""Rules of the benchmarks: 1 s in place and standing, in time, without contact. Alignment is measured
when the kart stands."""
SIMPLE: Final = Rules(seconds="none", farthest_m=30.0)
"""First reward of the thesis: -1 beyond 30 m or at the time limit, +1 within 0.5 m."""
ALIGNED: Final = Rules(reversing_ends=True, wheel_degrees=15.0, error_degrees=10.0)
"""Second reward of the thesis. Its angles are judged in place, since a kart on its way points anywhere."""
WITHOUT_DWELL: Final = Rules(seconds="none", reversing_ends=True, wheel_degrees=15.0, error_degrees=10.0)
WITHOUT_ALIGNMENT: Final = Rules(reversing_ends=True)
LITERAL: Final = Rules(seconds="elapsed", reversing_ends=True, wheel_degrees=15.0, error_degrees=10.0)

ALIGNED_ANGLE_RAD: Final = math.radians(3.0)
ALIGNED_DEVIATION_M: Final = 0.2
"""ISO 16787:2017 as the thesis quotes it: inclination within 3 degrees, deviation below 0.2 m."""
