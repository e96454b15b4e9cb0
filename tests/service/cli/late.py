"""An agent that is late once, for the deadlines of commands."""

from __future__ import annotations

import time

import numpy as np

from tests.evaluation.agents import Steady


class LateOnce(Steady):
    """Takes six seconds for one decision."""

    def misbehave(self) -> np.ndarray:
        if self.ticks == self.after + 1:
            time.sleep(6.0)
        return super().misbehave()
