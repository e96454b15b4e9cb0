"""The judge: one rule for when an episode ends, for runners, tests and benchmarks of speed."""

from __future__ import annotations

from itertools import pairwise

import pytest

from dohyo.evaluation.criteria.red_light import RedLight
from dohyo.evaluation.episode.judge import Judge
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from dohyo.sumo_networks.world import LightState
from tests.worlds import Scene, kinds, lit_crossing, straight_road

ANYWHERE = Mission(start=Place(lane="a"), goal=Place(lane="b"))


def judged(scene: Scene, seconds: float, **rules: object) -> tuple[Judge, list[Status | None]]:
    """A judge with all criteria, and what it said of every tick up to the end."""
    scenario = Scenario.model_validate({"network": "hand-made", "missions": (ANYWHERE,)} | rules)
    judge, said = Judge(scenario, 0), []
    worlds = scene.worlds(seconds)
    judge.start(worlds[0])
    for before, after in pairwise(worlds):
        said.append(judge.update(before, after))
        if said[-1] is not None:
            judge.end(said[-1])
            break
    return judge, said


def test_a_flawless_drive_to_the_goal_is_perfect() -> None:
    judge, said = judged(straight_road().with_ego(x=980, speed=10.0), seconds=3.0)
    assert said[-1] is Status.COMPLETED
    assert judge.status is Status.PERFECT
    assert judge.duration_s == pytest.approx(0.1 * len(said))
    assert judge.driven_m == pytest.approx(len(said))
    assert judge.progress_m > 980.0


def test_with_an_infraction_it_is_only_complete() -> None:
    lane = lit_crossing().with_lights(LightState.RED)
    goal = lane.route.length
    judge, _ = judged(lane.with_ego(x=-30.0, speed=20.0), seconds=30.0)
    assert judge.status is Status.COMPLETED
    assert InfractionKind.RED_LIGHT in kinds(judge)
    assert judge.progress_m > 0.99 * goal - 10.0


@pytest.mark.parametrize(("stop", "status"), [(True, Status.COLLIDED), (False, None)])
def test_a_collision_ends_the_episode_where_the_scenario_says_so(stop: bool, status: Status | None) -> None:
    scene = straight_road().with_ego(x=50, speed=10.0).with_actor(x=60)
    judge, said = judged(scene, seconds=2.0, stop_on_collision=stop)
    assert said[-1] is status
    assert judge.contacts == 1
    assert kinds(judge) == [InfractionKind.COLLISION_VEHICLE]


def test_the_planned_duration_ends_it_to_the_tick_and_is_no_failure() -> None:
    judge, said = judged(straight_road().with_ego(x=50, speed=10.0), seconds=5.0, duration_s=2.0)
    assert said == [None] * 19 + [Status.FINISHED]
    assert judge.status is Status.FINISHED


def test_more_time_than_the_limit_is_a_failure() -> None:
    judge, said = judged(straight_road().with_ego(x=50, speed=10.0), seconds=5.0, time_limit_s=2.0)
    assert said == [None] * 20 + [Status.TIMED_OUT]
    assert kinds(judge) == [InfractionKind.ROUTE_TIMEOUT]


def test_an_infraction_that_ends_the_drive_comes_before_the_goal() -> None:
    judge, _ = judged(straight_road().with_ego(x=980, speed=10.0), seconds=3.0, time_limit_s=0.05)
    assert judge.status is Status.TIMED_OUT


def test_what_is_known_only_at_the_end_stands_at_its_own_time() -> None:
    astray = straight_road().with_ego(x=50, speed=10.0, left=-3.0, drift=lambda t: 1.0 if t > 1 else 0.0)
    judge, _ = judged(astray.with_actor(x=75, left=-3.0, length=1.0), seconds=4.0, duration_s=3.5)
    times = [one.time_s for one in judge.infractions]
    assert kinds(judge)[0] is InfractionKind.OUTSIDE_LANES
    assert times == sorted(times)
    assert len(times) == 2
    assert 0.0 < judge.outside_lanes_m < judge.driven_m


def test_only_the_criteria_given_are_asked() -> None:
    worlds = straight_road().with_ego(x=50, speed=10.0).with_actor(x=60).worlds(2.0)
    judge = Judge(Scenario(network="hand-made", missions=(ANYWHERE,)), 0, [RedLight()])
    judge.start(worlds[0])
    assert {judge.update(before, after) for before, after in pairwise(worlds)} == {None}
    judge.end(Status.FINISHED)
    assert judge.infractions == []
    assert judge.contacts == 0


def test_an_episode_that_never_began_can_end() -> None:
    judge = Judge(Scenario(network="hand-made", missions=(ANYWHERE,)), 0)
    judge.end(Status.SIMULATION)
    assert (judge.status, judge.infractions, judge.duration_s) == (Status.SIMULATION, [], 0.0)
