from __future__ import annotations

import dataclasses
import math

import pytest

from dohyo.evaluation.criteria.minimum_speed import MinimumSpeed
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.actors.names import event_actor, event_vehicle
from dohyo.sumo_networks.scenario import Mission, Place
from dohyo.sumo_networks.world import ActorKind, EventPhase, EventState, World
from tests.worlds import LANE_M, Scene, Speed, kinds, run, straight_road


def hundred_metres(speed: Speed = 10.0) -> Scene:
    mission = Mission(start=Place(lane="w_e_0"), goal=Place(lane="w_e_0", position_m=100.0))
    return dataclasses.replace(straight_road(), mission=mission).with_ego(x=0, speed=speed)


def test_without_traffic_nothing_is_too_slow() -> None:
    assert run(hundred_metres(1.0), MinimumSpeed(shortest_part_m=25.0), seconds=100).infractions == []


@pytest.mark.parametrize("traffic", [5.0, 9.9])
def test_faster_than_the_traffic_is_fine(traffic: float) -> None:
    scene = hundred_metres().with_actor(x=5, speed=traffic, left=LANE_M)
    assert run(scene, MinimumSpeed(shortest_part_m=25.0), seconds=10).infractions == []


def test_slower_than_the_traffic_counts_on_each_of_four_parts() -> None:
    scene = hundred_metres().with_actor(x=5, speed=12.5, left=LANE_M)
    verdict = run(scene, MinimumSpeed(shortest_part_m=25.0), seconds=10)
    assert kinds(verdict) == [InfractionKind.MINIMUM_SPEED] * 4
    assert [one.magnitude for one in verdict.infractions] == pytest.approx([80.0] * 4)
    assert {one.unit for one in verdict.infractions} == {"%"}
    assert [one.route_m for one in verdict.infractions] == pytest.approx([25, 50, 75, 100], abs=1.01)


def test_a_short_route_is_one_part() -> None:
    scene = hundred_metres().with_actor(x=5, speed=12.5, left=LANE_M)
    assert len(run(scene, MinimumSpeed(), seconds=10).infractions) == 1


def test_a_part_that_was_not_driven_to_its_end_is_not_judged() -> None:
    scene = hundred_metres().with_actor(x=5, speed=12.5, left=LANE_M)
    assert len(run(scene, MinimumSpeed(shortest_part_m=25.0), seconds=8.5).infractions) == 3
    assert len(run(scene, MinimumSpeed(shortest_part_m=25.0), seconds=2).infractions) == 0


@pytest.mark.parametrize(("seconds", "count"), [(18.8, 0), (19.2, 1)])
def test_the_last_part_counts_as_driven_after_95_percent_of_the_route(seconds: float, count: int) -> None:
    scene = straight_road().with_ego(x=0, speed=50).with_actor(x=5, speed=55, left=LANE_M)
    assert len(run(scene, MinimumSpeed(checkpoints=1), seconds=seconds).infractions) == count


def test_each_part_is_judged_by_itself() -> None:
    scene = hundred_metres(lambda time: 10.0 if time < 5.05 else 5.0).with_actor(x=5, speed=8, left=LANE_M)
    verdict = run(scene, MinimumSpeed(shortest_part_m=25.0), seconds=15)
    assert [one.magnitude for one in verdict.infractions] == pytest.approx([62.5] * 2, rel=0.02)


def test_the_traffic_is_the_mean_of_all_standing_ones_included() -> None:
    scene = hundred_metres().with_actor(x=5, speed=20, left=LANE_M)
    assert len(run(scene, MinimumSpeed(shortest_part_m=25.0), seconds=4).infractions) == 1
    mixed = scene.with_actor(x=30, speed=0.0, left=2 * LANE_M).with_actor(x=40, speed=0.0, left=2 * LANE_M)
    assert run(mixed, MinimumSpeed(shortest_part_m=25.0), seconds=4).infractions == []


def in_an_event(scene: Scene, name: str) -> list[World]:
    """The worlds of a scene whose last actor belongs to an event."""
    key = len(scene.world().names) - 1
    event = EventState("crash", "accident", 0, EventPhase.ACTIVE, 0.0, math.nan, (key,), 50.0)
    names = (*scene.world().names[:key], name)
    return [dataclasses.replace(world, events=(event,), names=names) for world in scene.worlds(seconds=10)]


@pytest.mark.parametrize("crashed", [False, True])
def test_a_crashed_car_of_an_event_is_no_traffic(crashed: bool) -> None:
    scene = hundred_metres().with_actor(x=5, speed=12.5, left=LANE_M).with_actor(x=50, left=LANE_M)
    worlds = in_an_event(scene, event_actor("crash", 0)) if crashed else scene.worlds(seconds=10)
    verdict = run(worlds, MinimumSpeed())
    assert [one.magnitude for one in verdict.infractions] == pytest.approx([80.0] * crashed)


def test_one_of_an_event_is_traffic_once_it_moves_and_when_it_stands_again() -> None:
    scene = hundred_metres().with_actor(x=5, speed=15, left=LANE_M)
    scene = scene.with_actor(x=50, speed=lambda time: 10.0 if 0.95 < time < 1.05 else 0.0, left=LANE_M)
    assert run(in_an_event(scene, event_actor("crash", 0)), MinimumSpeed()).infractions == []


def test_a_vehicle_that_an_event_sends_is_traffic_also_while_it_stands() -> None:
    scene = hundred_metres().with_actor(x=5, speed=12.5, left=LANE_M).with_actor(x=50, left=LANE_M)
    assert run(in_an_event(scene, event_vehicle("crash", 0)), MinimumSpeed()).infractions == []


@pytest.mark.parametrize("kind", [ActorKind.BICYCLE, ActorKind.PEDESTRIAN, ActorKind.STATIC, ActorKind.EMERGENCY])
def test_only_motor_vehicles_are_the_traffic(kind: ActorKind) -> None:
    scene = hundred_metres().with_actor(x=5, speed=20, left=LANE_M, kind=kind)
    assert run(scene, MinimumSpeed(shortest_part_m=25.0), seconds=10).infractions == []


def test_another_ego_is_no_traffic() -> None:
    assert (
        run(
            hundred_metres().with_ego(x=5, speed=20, left=LANE_M), MinimumSpeed(shortest_part_m=25.0), seconds=10
        ).infractions
        == []
    )


def test_vehicles_out_of_sight_are_not_known() -> None:
    scene = hundred_metres().with_actor(x=150, speed=20, left=LANE_M)
    assert run(scene, MinimumSpeed(shortest_part_m=25.0), seconds=10).infractions == []


@pytest.mark.parametrize(("alone", "in_traffic", "count"), [(0.0, 9.0, 0), (20.0, 5.0, 1)])
def test_ticks_without_traffic_count_neither_against_the_ego_nor_for_it(
    alone: float, in_traffic: float, count: int
) -> None:
    scene = hundred_metres(lambda time: alone if time < 1.05 else in_traffic)
    # The other jumps into sight after 1.1 s.
    coming = scene.with_actor(x=0, speed=8, y=500, drift=lambda time: -5000.0 if 1.05 < time < 1.15 else 0.0)
    verdict = run(coming, MinimumSpeed(shortest_part_m=25.0), seconds=4)
    assert [one.magnitude for one in verdict.infractions] == pytest.approx([62.5] * count)
