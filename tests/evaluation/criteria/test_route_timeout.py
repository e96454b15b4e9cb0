from __future__ import annotations

import dataclasses

import pytest

from dohyo.evaluation.criteria import criteria_for
from dohyo.evaluation.criteria.route_timeout import RouteTimeout, travel_time
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.sumo_networks.rules.episode_end import is_late
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from dohyo.sumo_networks.units import TICK_S
from tests.worlds import kinds, run, straight_road


@pytest.mark.parametrize(("seconds", "count"), [(4.9, 0), (5.1, 1), (8.0, 1)])
def test_the_given_limit_counts_once(seconds: float, count: int) -> None:
    verdict = run(straight_road().with_ego(x=50, speed=10), RouteTimeout(limit_s=5.0), seconds=seconds)
    assert kinds(verdict) == [InfractionKind.ROUTE_TIMEOUT] * count
    assert [one.magnitude for one in verdict.infractions] == pytest.approx([5.1] * count)
    assert all(one.unit == "s" for one in verdict.infractions)


@pytest.mark.parametrize("ticks", [3, 50, 17, 2999])
def test_at_the_limit_an_ego_is_not_late_whatever_a_time_rounds_to(ticks: int) -> None:
    start = straight_road().with_ego(x=50).world()
    at, after = (dataclasses.replace(start, time=tick * TICK_S) for tick in (ticks, ticks + 1))
    limit_s = round(ticks * TICK_S, 1)
    assert [is_late(world, limit_s) for world in (at, after)] == [False, True]
    assert len(run([start, at], RouteTimeout(limit_s)).infractions) == 0
    assert len(run([start, at, after], RouteTimeout(limit_s)).infractions) == 1


@pytest.mark.parametrize(("early", "count"), [(0.5, 0), (-0.5, 1)])
def test_the_default_limit_is_300_s_and_a_tenth_of_the_speed_limit(early: float, count: int) -> None:
    start = straight_road().with_ego(x=50).world()
    late = dataclasses.replace(start, time=300.0 + 999.0 / 1.389 - early)
    assert len(run([start, late], RouteTimeout()).infractions) == count


def test_travel_time_adds_up_the_local_limits() -> None:
    route = straight_road().route
    slow_end = dataclasses.replace(route, speed_limit=route.speed_limit.copy())
    slow_end.speed_limit[500:] = 5.0
    assert travel_time(route) == pytest.approx(999 / 13.89)
    assert travel_time(slow_end) == pytest.approx(500 / 13.89 + 499 / 5.0)


def test_the_scenarios_limit_is_used() -> None:
    mission = Mission(start=Place(lane="a"), goal=Place(lane="b"))
    scenario = Scenario(network="x", missions=(mission,), time_limit_s=3.0)
    verdict = run(straight_road().with_ego(x=50, speed=10), *criteria_for(scenario), seconds=4)
    assert kinds(verdict) == [InfractionKind.ROUTE_TIMEOUT]


def test_criteria_are_fresh_each_time() -> None:
    mission = Mission(start=Place(lane="a"), goal=Place(lane="b"))
    scenario = Scenario(network="x", missions=(mission,))
    assert not set(map(id, criteria_for(scenario))) & set(map(id, criteria_for(scenario)))


def test_it_ends_the_episode() -> None:
    assert InfractionKind.ROUTE_TIMEOUT.specification.ends is Status.TIMED_OUT
