"""nuPlan's open-loop score: how near a planner's plans are to what was driven.

Once a second a plan of 8 s is compared with the next 8 s that were driven, a pose per second, up to 3, 5 and 8 s. A
drive's score is 0 if more than 30 % of its plans miss by more than 6, 8 and 16 m; else it is the weighted mean of four
terms, each falling from 1 to 0 at its bound: mean and final distance (8 m, weight 1), mean and final error of the
heading (0.8 rad, weight 2).

Source: nuPlan's description of metrics and of their aggregation, with the horizons of its challenge of 2023.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.geometry import wrap_angle

HORIZONS_S: Final = (3, 5, 8)
MISSED_M: Final = (6.0, 8.0, 16.0)
MOST_MISSES: Final = 0.3
FAR_M, TURNED_RAD = 8.0, 0.8
WEIGHTS: Final = (1.0, 1.0, 2.0, 2.0)


def open_loop_score(planned: FloatArray, driven: FloatArray) -> float:
    """Score of one drive, from 0 to 100.

    Args:
        planned: (T, 8, 3) x, y [m], heading [rad] in 1, 2, ..., 8 s, of T plans a second apart.
        driven: (T, 8, 3) where the vehicle was then.

    Raises:
        InvalidInputError: There are no plans, the shapes differ, or a value is not finite.
    """
    shape = (len(planned), HORIZONS_S[-1], 3)
    if not len(planned) or planned.shape != shape or driven.shape != shape:
        raise InvalidInputError(
            f"open-loop score: expected plans and drives of (T, {shape[1]}, 3), T above 0, got {planned.shape} and "
            f"{driven.shape}"
        )
    for what, values in (("plans", planned), ("drives", driven)):
        if not np.isfinite(values).all():
            first = int(np.flatnonzero(~np.isfinite(values).all(axis=(1, 2)))[0])
            raise InvalidInputError(f"open-loop score: expected finite {what}, got NaN or infinity at {first} s")
    distance = np.linalg.norm(planned[..., :2] - driven[..., :2], axis=-1)
    turned = np.abs(wrap_angle(planned[..., 2] - driven[..., 2]))
    for horizon, bound in zip(HORIZONS_S, MISSED_M, strict=True):
        if float(np.mean(distance[:, :horizon].max(axis=1) > bound)) > MOST_MISSES:
            return 0.0
    terms = (
        _within(_mean(distance), FAR_M), _within(_final(distance), FAR_M),
        _within(_mean(turned), TURNED_RAD), _within(_final(turned), TURNED_RAD),
    )  # fmt: skip
    return 100.0 * float(np.average(terms, weights=WEIGHTS))


def _mean(errors: FloatArray) -> float:
    """Mean over plans and horizons of the mean error up to each horizon."""
    return float(np.mean([errors[:, :horizon].mean() for horizon in HORIZONS_S]))


def _final(errors: FloatArray) -> float:
    """Mean over plans and horizons of the error at each horizon."""
    return float(np.mean([errors[:, horizon - 1].mean() for horizon in HORIZONS_S]))


def _within(error: float, bound: float) -> float:
    return max(0.0, 1.0 - error / bound)
