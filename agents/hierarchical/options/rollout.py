"""Option rollout: a running option, and its samples once it has ended.

An option that began in one state could have begun in every later one, since neither its policy nor its end depends on
its begin. So every suffix is a sample of SMDP Q-learning. A lane change is the exception: begun half way, it would lead
one lane farther.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from dohyo.agents.hierarchical.options.executor import OptionExecutor
from dohyo.agents.hierarchical.options.manoeuvres import CHANGES
from dohyo.agents.hierarchical.state.master_observation import OPTIONS
from dohyo.sumo_networks.arrays import Float32Array


class OptionSample(NamedTuple):
    """Sample: an option from one state to its end.

    Attributes:
        state: At its begin.
        total: Discounted rewards from there.
        ticks: From there.
    """

    state: Float32Array
    total: float
    ticks: int


@dataclass(slots=True)
class OptionRollout:
    """Running option of one environment.

    Attributes:
        executor: Executes the option.
        states: Before each of its ticks; None where the rules drove.
        rewards: Of each of its ticks.
    """

    executor: OptionExecutor
    states: list[Float32Array | None] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)

    def add(self, state: Float32Array | None, reward: float) -> None:
        """Adds one tick."""
        self.states.append(state)
        self.rewards.append(reward)
        self.executor.tick()

    def samples(self, gamma: float) -> Iterator[OptionSample]:
        """Samples of the ended option, the last state first."""
        total, option = 0.0, OPTIONS[self.executor.option or 0]
        for ticks, (state, reward) in enumerate(zip(self.states[::-1], self.rewards[::-1], strict=True), 1):
            total = reward + gamma * total
            if state is not None and (option not in CHANGES or ticks == len(self.states)):
                yield OptionSample(state, total, ticks)

    def clear(self) -> None:
        """Clears the rollout, not the executor."""
        self.states, self.rewards = [], []
