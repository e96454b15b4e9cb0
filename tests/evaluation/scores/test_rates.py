from __future__ import annotations

import pytest

from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.scores.driving import route_km
from dohyo.evaluation.scores.rates import infraction_counts, infractions_per_km
from tests.evaluation.builders import ego, infraction

RED = infraction(InfractionKind.RED_LIGHT)


def test_rates_are_pooled_over_drives() -> None:
    short = ego(RED, RED, progress_m=10.0)
    long = ego(RED, progress_m=2990.0, route_length_m=4000.0)
    rates = infractions_per_km([short, long])
    assert rates[InfractionKind.RED_LIGHT] == pytest.approx(3 / 3.0)
    assert rates[InfractionKind.STOP_SIGN] == 0.0
    assert set(rates) == set(InfractionKind)


def test_distance_is_measured_along_the_route() -> None:
    assert route_km(ego(progress_m=500.0, driven_m=900.0)) == pytest.approx(0.5)
    assert route_km(ego(status=Status.COMPLETED, progress_m=998.0)) == pytest.approx(1.0)


def test_an_ego_that_never_moved_is_divided_by_a_metre() -> None:
    assert infractions_per_km([ego(RED, progress_m=0.0)])[InfractionKind.RED_LIGHT] == pytest.approx(1000.0)


def test_outside_lanes_and_minimum_speed_are_events() -> None:
    outside = infraction(InfractionKind.OUTSIDE_LANES, magnitude=300.0)
    slow = infraction(InfractionKind.MINIMUM_SPEED, magnitude=40.0)
    counts = infraction_counts(ego(outside, slow, slow))
    assert counts[InfractionKind.OUTSIDE_LANES] == 1
    assert counts[InfractionKind.MINIMUM_SPEED] == 2


def test_no_drives_no_infractions() -> None:
    assert set(infractions_per_km([]).values()) == {0.0}
