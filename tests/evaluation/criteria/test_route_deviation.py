from __future__ import annotations

import pytest

from dohyo.evaluation.criteria.route_deviation import RouteDeviation
from dohyo.evaluation.records.specifications import InfractionKind, Status
from tests.worlds import kinds, run, straight_road


@pytest.mark.parametrize(("away", "count"), [(29.9, 0), (30.1, 1)])
@pytest.mark.parametrize("side", [-1, 1])
def test_thirty_metres_from_the_route_is_a_deviation(away: float, side: int, count: int) -> None:
    scene = straight_road().with_ego(x=50, speed=5, left=side * away)
    verdict = run(scene, RouteDeviation(), seconds=2)
    assert kinds(verdict) == [InfractionKind.ROUTE_DEVIATION] * count
    assert [one.magnitude for one in verdict.infractions] == pytest.approx([away] * count)
    assert all(one.unit == "m" for one in verdict.infractions)


@pytest.mark.parametrize(("away", "seconds", "count"), [(16, 9.9, 0), (16, 10.1, 1), (14.9, 20, 0)])
def test_too_much_progress_beside_the_route_is_a_deviation(away: float, seconds: float, count: int) -> None:
    scene = straight_road().with_ego(x=50, speed=30, left=-away)  # 30 % of its 999 m after 10 s
    assert len(run(scene, RouteDeviation(), seconds=seconds).infractions) == count


def test_progress_beside_the_route_adds_up_over_several_departures() -> None:
    away, back = straight_road().with_ego(x=50, speed=30, left=-16), straight_road().with_ego(x=200, speed=30)
    again = straight_road().with_ego(x=230, speed=30, left=-16)
    first = away.worlds(5)
    second = back.worlds(1, after=first[-1])
    third = again.worlds(5.3, after=second[-1])
    assert len(run([*first, *second, *third], RouteDeviation()).infractions) == 1
    assert run([*first, *second, *third[:-10]], RouteDeviation()).infractions == []


def test_standing_beside_the_route_is_no_deviation() -> None:
    assert run(straight_road().with_ego(x=50, speed=0, left=-20), RouteDeviation(), seconds=20).infractions == []


def test_driving_on_past_the_goal_is_a_deviation() -> None:
    scene = straight_road().with_ego(x=990, speed=10)
    assert len(run(scene, RouteDeviation(), seconds=3.5).infractions) == 0
    assert len(run(scene, RouteDeviation(), seconds=4.5).infractions) == 1


def test_it_ends_the_episode() -> None:
    assert InfractionKind.ROUTE_DEVIATION.specification.ends is Status.DEVIATED
