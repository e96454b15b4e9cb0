"""Option executor: runs the chosen option until it is done, no longer possible, or terminated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from dohyo.agents.hierarchical.options.manoeuvres import CHANGES
from dohyo.agents.hierarchical.options.values import choose
from dohyo.agents.hierarchical.state.master_observation import OPTIONS
from dohyo.sumo_networks.arrays import BoolArray, Float32Array
from dohyo.sumo_networks.config import Config

Ticks = Annotated[int, Field(ge=1, le=6000)]
_CHANGES = tuple(OPTIONS.index(change) for change in CHANGES)


class OptionLimits(Config):
    """Duration of options, in ticks of 0.1 s (ours).

    Attributes:
        least_ticks: Before that, beta is not evaluated.
        most_ticks: After that, the master chooses again.
    """

    least_ticks: Ticks = 5
    most_ticks: Ticks = 50


@dataclass(frozen=True, slots=True)
class OptionView:
    """Outputs of the master in one tick.

    Attributes:
        q: (options,) Q_Omega.
        beta: (options,) terminations.
        available: (options,) options that may begin.
        finished: Whether the running option has reached its goal.
        critical: Whether the rules drive.
    """

    q: Float32Array
    beta: Float32Array
    available: BoolArray
    finished: bool
    critical: bool


class OptionExecutor:
    """Executes options.

    Attributes:
        option: Number of the running one; None before the first.
        ticks: Duration of the running one so far.
    """

    def __init__(self, tempo: OptionLimits) -> None:
        """Begins without an option."""
        self._tempo = tempo
        self.reset()

    def reset(self) -> None:
        """Clears the state of the last episode."""
        self.option: int | None = None
        self.ticks = 0
        self._interrupted = False

    def ends(self, prospect: OptionView, draw: float) -> bool:
        """Whether the running option is over; True also without one.

        While the rules drive, nothing ends; after that, the master chooses again.

        Args:
            prospect: Present outputs.
            draw: In [0, 1), uniformly, for a termination of probability beta; or 0.5, to end where it is likelier.
        """
        if self.option is None:
            return True
        if prospect.critical:
            self._interrupted = True
            return False
        # A lane change that has begun is completed; other options end where they may not begin.
        impossible = self.option not in _CHANGES and not prospect.available[self.option]
        if self._interrupted or prospect.finished or impossible or self.ticks >= self._tempo.most_ticks:
            return True
        return self.ticks >= self._tempo.least_ticks and draw < float(prospect.beta[self.option])

    def begin(self, prospect: OptionView, epsilon: float = 0.0, rng: np.random.Generator | None = None) -> int:
        """Chooses the next option, at random with probability epsilon; its number."""
        self.option = choose(prospect.q, prospect.available, epsilon, rng or np.random.default_rng(0))
        self.ticks, self._interrupted = 0, False
        return self.option

    def tick(self) -> None:
        """Counts one tick."""
        self.ticks += 1
