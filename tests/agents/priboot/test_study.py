"""Tables of the study: longer routes of the same driving lower the driving score, and not the infraction rate score."""

from __future__ import annotations

import math

import pytest

from dohyo.agents.priboot.study.tables import JOINED, joined
from dohyo.agents.studies.rows import Row


def drive(done: float, collisions: int) -> Row:
    """A kilometre of which a share was driven, with collisions with vehicles (p = 0.6)."""
    driven = 1000.0 * done
    rate = math.exp(-4.0 * collisions * (1.0 - 0.6) / done)
    return {
        "route_m": 1000.0, "driven_m": driven, "route_completion": 100.0 * done,
        "infraction_penalty": 0.6**collisions, "irs": 100.0 * done * rate,
    }  # fmt: skip


def test_at_a_constant_rate_only_the_driving_score_falls_with_the_length() -> None:
    found = {count: joined([drive(0.8, 1)], count) for count in JOINED}
    for count, (penalty, score, irs, by_route) in found.items():
        assert penalty == pytest.approx(0.6**count)
        assert score == pytest.approx(80.0 * 0.6**count)
        assert irs == pytest.approx(80.0 * math.exp(-2.0))
        assert by_route == pytest.approx(80.0 * math.exp(-1.6))
