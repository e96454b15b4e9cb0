"""Intrinsic rewards: models that reward a learner's transitions beside its task, and learn from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import torch
from tensordict import TensorDictBase
from torch import Tensor

from dohyo.agents.learning.files.metrics import Number


class IntrinsicReward(Protocol):
    """Source of rewards. Its randomness comes from torch's global generator.

    Attributes:
        columns: Of metrics.csv: the mean reward of a round, then what `update` returns.
    """

    columns: tuple[str, ...]

    def reward(self, transitions: TensorDictBase) -> Tensor:
        """(B, 1) rewards of (B,) transitions, to be added to those of the task."""

    def update(self, transitions: TensorDictBase) -> Mapping[str, Number]:
        """Learns from the (B,) transitions of a round; values of the columns after the first."""

    def state(self) -> dict[str, Any]:
        """State for a checkpoint, as tensors and plain values."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""


def add_intrinsic(sources: Sequence[IntrinsicReward], transitions: TensorDictBase) -> dict[str, Number]:
    """Adds the rewards of all sources to those of (...) transitions; then the sources learn from these.

    Args:
        sources: All judge the transitions before one of them learns.
        transitions: Of one round; ("next", "reward") changes in the rows that were "active" (absent: all).

    Returns:
        The sources' columns.
    """
    active = transitions.get("active", torch.ones(transitions.shape, dtype=torch.bool, device=transitions.device))
    if not sources:
        return {}
    lived, row = transitions[active], dict[str, Number]()
    rewards = [source.reward(lived) for source in sources]
    for source, reward in zip(sources, rewards, strict=True):
        transitions["next", "reward"][active] += reward
        row |= {source.columns[0]: float(reward.mean()), **source.update(lived)}
    return row
