"""Study: longer routes of the same driving lower the driving score alone; and where an ego loses its time."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from dohyo.agents.priboot.study import hesitation
from dohyo.agents.priboot.study.tables import JOINED, joined
from dohyo.agents.studies.rows import Row
from dohyo.sumo_networks.scenario import Traffic
from tests.agents.priboot.test_priboot import policy


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


def test_an_ego_that_stands_on_a_free_road_loses_all_its_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hesitation, "LONGEST_S", 5.0)
    drawn = hesitation.MISSIONS.scenarios()[0]
    empty = drawn.model_copy(update={"traffic": Traffic(), "events": ()})
    stands = policy(tmp_path, 0.0)
    metres, ticks = hesitation.lost_time(empty, "priboot", stands)
    assert ticks["stands though it could go"] == ticks["stands"] == ticks["time"] == 50
    assert metres < 1.0
    metres, ticks = hesitation.lost_time(empty, "autopilot", stands)
    assert ticks["stands"] < 15
    assert metres > 5.0
