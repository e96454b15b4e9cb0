"""Paired differences as boards and comparisons show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dohyo.evaluation.significance import FEWEST
from dohyo.evaluation.statistics import Comparison, paired


def compare_pairs(ours: Sequence[float], theirs: Sequence[float]) -> Comparison:
    """`paired`, without a probability where fewer than six pairs differ.

    No outcome of the test is significant there, whatever resamples of so few differences say.

    Raises:
        InvalidInputError: If the lengths differ, there is no pair, or a value is not finite.
    """
    found = paired(ours, theirs)
    differing = sum(a != b for a, b in zip(ours, theirs, strict=True))
    return found if differing >= FEWEST else replace(found, probability=None)
