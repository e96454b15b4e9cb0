"""Divergence: a training whose losses or actions are no longer finite ends in words, before a checkpoint keeps it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from tensordict import TensorDictBase

from dohyo.agents.learning.tasks.task import Array
from dohyo.sumo_networks.errors import DohyoError


def check_finite(losses: Mapping[str, float]) -> None:
    """Raises DohyoError if a loss is not finite: what was learned is lost, and no checkpoint may keep it."""
    if lost := [name for name, value in losses.items() if not math.isfinite(value)]:
        raise _diverged(f"{', '.join(lost)} expected to be finite", "a lower learning rate or smaller rewards")


def check_actions(actions: Array, observation: TensorDictBase) -> None:
    """Checks what a learner's policy has chosen.

    Args:
        actions: (N, ...) actions.
        observation: (N, ...) by name, that they were chosen at.

    Raises:
        DohyoError: One is not finite; the message has the largest number that was seen.
    """
    if (finite := np.isfinite(actions)).all():
        return
    largest, name = max((float(one.float().abs().max()), name) for name, one in observation.items())
    raise _diverged(
        f"expected finite actions, got {actions[~finite][:4].tolist()}; the largest number of the observations is "
        f"{largest:.3g}, in '{name}'",
        "a lower learning rate, smaller rewards or smaller observations",
    )


def _diverged(what: str, remedy: str) -> DohyoError:
    return DohyoError(
        f"the training has diverged: {what}; it goes on from its last checkpoint, but {remedy} may be needed"
    )
