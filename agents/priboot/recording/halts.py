"""Halts: an ego is stopped before what stands in its lane, and let go when its demonstrator would go.

A demonstrator that sees an obstacle from afar mostly passes it without a stop. A learner that has stopped before one,
since it saw it late or others came, then never saw how to go on. Ours, after DAgger (Ross et al. 2011).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dohyo.agents.priboot.recording.disturbance import STANDING_M_S, STARTS
from dohyo.agents.priboot.rules import standing_gap
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.units import TICK_S

GAP_M, WAIT_S, LONGEST_S, PAUSE_S = (5.0, 14.0), (0.5, 3.5), 8.0, (1.0, 6.0)
"""Smallest and largest gap at which it stands, shortest and longest wait, the longest for a demonstrator that would not
go, and shortest and longest time from one stop to the next."""
BRAKING: Final = 4.0
"""Deceleration of a halt, m/s^2."""
TOLD_S: Final = 20.0
"""Longest time for which it is said to have stood: that does not matter to whether the way round is free."""


class Halts:
    """Drives on as the demonstrator does, but for stops before obstacles.

    Attributes:
        active: Whether the last tick was of a stop.
        stalls: The same.
        told_s: Time for which an ego that is held is said to have stood before.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng, self.active, self.stalls = rng, False, False
        self._pause = 0.0
        self._draw()

    def _draw(self) -> None:
        self._gap, self._wait = self._rng.uniform(*GAP_M), self._rng.uniform(*WAIT_S)
        self._stood = 0.0
        self.told_s: float | None = self._rng.uniform(0.0, TOLD_S)

    def disturbed(self, action: FloatArray, speed: float, observation: Observation) -> FloatArray:
        """(2,) acceleration and steering that the ego drives, given the demonstrator's."""
        self._pause = max(self._pause - TICK_S, 0.0)
        if not self.active and self._pause == 0.0:
            self.active = standing_gap(observation) - speed**2 / (2.0 * BRAKING) < self._gap
        elif self.active and speed < STANDING_M_S:
            self._stood += TICK_S
            if self._stood > (self._wait if action[0] >= STARTS else LONGEST_S):
                self.active, self._pause = False, self._rng.uniform(*PAUSE_S)
                self._draw()
        self.stalls = self.active
        return np.array([min(action[0], -BRAKING), action[1]]) if self.active else action
