"""GRIAD's discrete actions: 27 steering angles x 4 accelerations = 108; an expert's action becomes the nearest one.

Source: Chekroun 2024, section 4.3. The thesis has throttle and brake; ours are accelerations, and the angles lie closer
to each other near 0, so that a car keeps its lane at 40 km/h.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from dohyo.agents.learning.tasks.task import Array

CONTROL: Final = "acceleration_steering"
ACCELERATIONS: Final = (-6.0, -2.0, 0.0, 2.0)
"""m/s^2."""
STEERINGS: Final = 27


def _steerings() -> NDArray[np.float64]:
    """(27,) shares of full lock, of both signs, growing with the square of their number."""
    even = np.linspace(-1.0, 1.0, STEERINGS)
    return np.sign(even) * even**2


STEERING: Final = _steerings()
TABLE: Final[Array] = np.array([[a, s] for a in ACCELERATIONS for s in STEERING], np.float32)
"""(108, 2) actions of `CONTROL`, by number."""


def nearest(controls: Array) -> int:
    """Number of the choice nearest to an action of `CONTROL`, in each of its two parts."""
    pedal = int(np.abs(np.array(ACCELERATIONS) - float(controls[0])).argmin())
    return pedal * STEERINGS + int(np.abs(STEERING - float(controls[1])).argmin())
