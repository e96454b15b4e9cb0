"""First-order low-pass filter for each axis of the IMU.

Source: Albilani's thesis, 4.2.2: y[n] = alpha y[n-1] + (1 - alpha) x[n], alpha = t / (t + dt), cut-off 1 / (2 pi t).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

ALPHA = 0.6
"""The thesis's choice; at 100 Hz a time constant of 15 ms and a cut-off of 10.6 Hz."""


@dataclass
class LowPass:
    """A filter with memory.

    Attributes:
        alpha: Weight of the past, from 0 (no filter) to below 1.
    """

    alpha: float = ALPHA
    _last: FloatArray | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if not 0.0 <= self.alpha < 1.0:
            raise InvalidInputError(f"low-pass: expected alpha from 0 to below 1, got {self.alpha}")

    def step(self, sample: FloatArray) -> FloatArray:
        """Filtered sample; the first one passes unchanged."""
        previous = sample if self._last is None else self._last
        self._last = self.alpha * previous + (1.0 - self.alpha) * sample
        return self._last


def cut_off_hz(alpha: float, dt: float) -> float:
    """Frequency at which the analogue filter halves the power, Hz."""
    return math.inf if alpha == 0.0 else (1.0 - alpha) / (2.0 * math.pi * alpha * dt)


def delay_s(alpha: float, dt: float) -> float:
    """Delay of a slow signal, s: alpha / (1 - alpha) samples."""
    return alpha / (1.0 - alpha) * dt
