"""Spaces of an environment of its own."""

from __future__ import annotations

from gymnasium.spaces import Box


def own_space(space: Box) -> Box:
    """A box with the same bounds and a generator of its own.

    A process shares the boxes of sensors and controls; with one generator, the seed of one environment's space would
    decide the samples of another's.
    """
    return Box(space.low, space.high, dtype=space.dtype)
