from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dohyo.evaluation.criteria.collision import Collision
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import ActorKind
from tests.worlds import LANE_M, Scene, crossing_for_pedestrians, run, straight_road


def the_collision(scene: Scene, seconds: float = 2.0) -> Infraction:
    (collision,) = run(scene, Collision(), seconds=seconds).infractions
    return collision


@pytest.mark.parametrize(("gap", "contacts"), [(0.01, 0), (-0.01, 1)])
def test_the_bumpers_decide_to_the_centimetre(gap: float, contacts: int) -> None:
    scene = straight_road().with_ego(x=50, speed=5).with_actor(x=50 + 0.5 + 4.5 + gap)
    verdict = run(scene, seconds=TICK_S)
    assert len(verdict.infractions) == verdict.contacts == contacts


@pytest.mark.parametrize(("gap", "contacts"), [(0.01, 0), (-0.01, 1)])
def test_the_sides_decide_to_the_centimetre(gap: float, contacts: int) -> None:
    scene = straight_road().with_ego(x=50, speed=5).with_actor(x=49, speed=5, left=1.8 + gap)
    verdict = run(scene, seconds=1.0)
    assert len(verdict.infractions) == verdict.contacts == contacts


@pytest.mark.parametrize(("gap", "contacts"), [(0.01, 0), (-0.01, 1)])
def test_a_corner_of_a_turned_box_decides_to_the_centimetre(gap: float, contacts: int) -> None:
    half_diagonal = math.hypot(2.0, 2.0) / 2
    scene = straight_road().with_ego(x=50, speed=5)
    scene = scene.with_actor(
        x=50.5 + 2.25 + half_diagonal + gap, kind=ActorKind.STATIC, heading=math.pi / 4, length=2, width=2
    )
    assert run(scene, seconds=TICK_S).contacts == contacts


def test_a_standing_ego_hit_from_behind_is_not_at_fault() -> None:
    scene = straight_road().with_ego(x=50, speed=0).with_actor(x=44, speed=8, length=4.5)
    verdict = run(scene, seconds=2)
    assert verdict.infractions == []
    assert verdict.contacts == 1


def test_a_standing_ego_is_not_at_fault_either_where_its_hits_are_asked_for() -> None:
    scene = straight_road().with_ego(x=50, speed=0).with_actor(x=44, speed=8)
    (collision,) = run(scene, Collision(standing_mps=0.0)).infractions
    assert collision.at_fault is False


def test_a_moving_ego_hit_from_behind_is_not_at_fault() -> None:
    collision = the_collision(straight_road().with_ego(x=50, speed=5).with_actor(x=44, speed=10))
    assert collision.kind is InfractionKind.COLLISION_VEHICLE
    assert collision.at_fault is False
    assert collision.magnitude == pytest.approx(5.0)
    assert collision.unit == "m/s"
    assert collision.actor == "actor0"
    assert collision.time_s == pytest.approx(0.3)
    assert (collision.x_m, collision.route_m) == pytest.approx((51.5, 51.5))


def test_rear_ending_is_the_egos_fault() -> None:
    collision = the_collision(straight_road().with_ego(x=44, speed=10).with_actor(x=50, speed=5))
    assert collision.at_fault is True
    assert collision.magnitude == pytest.approx(5.0)


def test_meeting_head_on_closes_with_both_speeds() -> None:
    scene = straight_road().with_ego(x=50, speed=10).with_actor(x=60, speed=6, heading=math.pi)
    collision = the_collision(scene)
    assert collision.at_fault is True
    assert collision.magnitude == pytest.approx(16.0)


def test_a_standing_car_is_the_egos_fault_wherever_the_ego_touches_it() -> None:
    scene = straight_road().with_ego(x=50, speed=5, drift=1.0).with_actor(x=50, left=1.9)
    assert the_collision(scene).at_fault is True


def test_braking_to_a_stop_in_the_tick_of_the_impact_is_no_excuse() -> None:
    scene = straight_road().with_ego(x=50, speed=0).with_actor(x=54.49)
    clear = straight_road().with_ego(x=49.95, speed=0.7).with_actor(x=54.49)
    start = clear.world()
    collision = run([start, scene.worlds(0.0, after=start)[0]], Collision()).infractions[0]
    assert collision.at_fault is True
    assert collision.magnitude == pytest.approx(0.7)


@pytest.mark.parametrize(("left", "at_fault"), [(0.0, False), (LANE_M, False), (LANE_M / 2, True)])
def test_a_side_swipe_is_the_egos_fault_only_if_it_straddles_lanes(left: float, at_fault: bool) -> None:
    scene = straight_road().with_ego(x=50, speed=10, left=left)
    swiped = scene.with_actor(x=49, speed=10, left=left + 2.5, drift=-1.0)
    collision = the_collision(swiped)
    assert collision.at_fault is at_fault
    assert collision.magnitude == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("left", [-3.0, -5.0])
def test_a_side_swipe_beside_the_road_is_the_egos_fault(left: float) -> None:
    scene = straight_road().with_ego(x=50, speed=10, left=left).with_actor(x=49, speed=10, left=left + 2.5, drift=-1.0)
    assert the_collision(scene).at_fault is True


@pytest.mark.parametrize(("degrees", "at_fault"), [(145, True), (155, False)])
def test_even_a_straddling_ego_is_not_at_fault_for_what_comes_from_behind(degrees: float, at_fault: bool) -> None:
    # A bicycle so small that its place is the point of contact, at the rear corner of a long or a short ego.
    angle = math.radians(degrees)
    length = 2 * 0.9 / -math.tan(angle)
    scene = straight_road().with_ego(x=50, speed=5, left=LANE_M / 2, length=length)
    x, left = 50 - length / 2, LANE_M / 2 + 0.9
    scene = scene.with_actor(x=x - 0.05, left=left, speed=6, kind=ActorKind.BICYCLE, length=0.02, width=0.02)
    assert the_collision(scene).at_fault is at_fault


@pytest.mark.parametrize(
    "kind", [ActorKind.VAN, ActorKind.TRUCK, ActorKind.BUS, ActorKind.BICYCLE, ActorKind.EMERGENCY]
)
def test_everything_on_wheels_is_a_vehicle(kind: ActorKind) -> None:
    scene = straight_road().with_ego(x=50, speed=10).with_actor(x=60, speed=1, kind=kind)
    assert the_collision(scene).kind is InfractionKind.COLLISION_VEHICLE


def test_a_static_thing_is_the_egos_fault() -> None:
    scene = straight_road().with_ego(x=50, speed=10).with_actor(x=60, kind=ActorKind.STATIC, length=1, width=1)
    collision = the_collision(scene)
    assert collision.kind is InfractionKind.COLLISION_STATIC
    assert collision.at_fault is True
    assert collision.magnitude == pytest.approx(10.0)


@pytest.mark.parametrize("before_crossing_m", [0.0, 30.0])
@pytest.mark.parametrize("late_m", [0.0, 0.3, 0.6])
def test_a_pedestrian_ahead_is_the_egos_fault_on_a_crossing_and_off_it(before_crossing_m: float, late_m: float) -> None:
    scene = crossing_for_pedestrians()
    crossing = scene.network.lanes.crossing.nonzero()[0]
    x = min(float(scene.network.lane_shape(int(lane))[:, 0].mean()) for lane in crossing) - before_crossing_m
    y = float(scene.route.position[0, 1])
    scene = scene.with_ego(x=x - 10 - late_m, speed=8).with_pedestrian(x, 1.4, y=y - 1.4, heading=math.pi / 2)
    collision = the_collision(scene)
    assert collision.kind is InfractionKind.COLLISION_PEDESTRIAN
    assert collision.at_fault is True
    assert collision.magnitude == pytest.approx(math.hypot(8.0, 1.4))


def test_a_pedestrian_who_walks_into_the_egos_side_is_not_the_egos_fault() -> None:
    scene = straight_road().with_ego(x=50, speed=5)
    collision = the_collision(scene.with_pedestrian(51.5, 1.4, y=-4.8 - 0.9 - 0.6, heading=math.pi / 2))
    assert collision.kind is InfractionKind.COLLISION_PEDESTRIAN
    assert collision.at_fault is False


def test_another_ego_is_a_vehicle() -> None:
    scene = straight_road().with_ego(x=50, speed=10).with_ego(x=60, speed=2)
    hitting, hit = run(scene, Collision(), ego=0), run(scene, Collision(), ego=1)
    assert [(one.kind, one.actor, one.at_fault) for one in hitting.infractions] == [
        (InfractionKind.COLLISION_VEHICLE, "ego1", True)
    ]
    assert [(one.actor, one.at_fault) for one in hit.infractions] == [("ego", False)]
    assert hitting.contacts == hit.contacts == 1


def swiping_at(*times: float) -> Scene:
    """A car beside the ego touches it for a moment, 0.2 s after each of some times."""

    def drift(time: float) -> float:
        since = min((time - start for start in times if time > start + 1e-9), default=math.inf)
        return -1.0 if since < 0.41 else 1.0 if since < 0.81 else 0.0

    return straight_road().with_ego(x=50, speed=8).with_actor(x=49, speed=8, left=2.0, drift=drift)


@pytest.mark.parametrize(("again_at", "count"), [(3.0, 1), (8.0, 2)])
def test_the_same_actor_counts_again_only_after_five_seconds(again_at: float, count: int) -> None:
    verdict = run(swiping_at(0.0, again_at), Collision(), seconds=10)
    assert len(verdict.infractions) == count
    assert verdict.contacts == 1


@pytest.mark.parametrize("begin_s", [3.3, 3.4, 3.5, 3.6])
def test_five_seconds_are_the_same_from_whatever_tick_on(begin_s: float) -> None:
    """From tick 41 on they are less in floating point."""
    for pause_s, count in ((5.3, 1), (5.4, 2)):
        verdict = run(swiping_at(begin_s, begin_s + pause_s), Collision(), seconds=12)
        assert len(verdict.infractions) == count


def test_each_contact_keeps_the_five_seconds_running() -> None:
    assert len(run(swiping_at(0.0, 4.0, 8.0), Collision(), seconds=10).infractions) == 1


def test_a_contact_that_lasts_is_one_collision() -> None:
    scene = straight_road().with_ego(x=50, speed=8).with_actor(x=49, speed=8, left=1.79)
    assert len(run(scene, Collision(), seconds=12).infractions) == 1


def test_driving_on_after_being_hit_while_standing_is_no_collision() -> None:
    def starts_late(time: float) -> float:
        return 2.0 if time > 1.0 else 0.0

    scene = straight_road().with_ego(x=50, speed=starts_late).with_actor(x=44, speed=8)
    verdict = run(scene, Collision(), seconds=3)
    assert (verdict.infractions, verdict.contacts) == ([], 1)


@pytest.mark.parametrize(("ahead_m", "count"), [(0.1, 1), (-1.0, 0)])
def test_driving_over_who_walked_into_the_standing_ego_is_one(ahead_m: float, count: int) -> None:
    def starts_late(time: float) -> float:
        return 2.0 if time > 2.0 else 0.0

    def walks_until_it_touches(time: float) -> float:
        return 1.4 if time < 1.0 else 0.0

    scene = straight_road().with_ego(x=50, speed=starts_late)
    front_m = 50 + 0.5 + 4.5 / 2
    scene = scene.with_pedestrian(front_m + ahead_m + 1.4, walks_until_it_touches, y=-4.8, heading=math.pi)
    verdict = run(scene, Collision(), seconds=4)
    assert (len(verdict.infractions), verdict.contacts) == (count, 1)
    assert all(one.at_fault and one.time_s > 2.0 for one in verdict.infractions)


@pytest.mark.parametrize(("apart", "count"), [(0.1, 1), (4.0, 2), (6.0, 2)])
def test_hits_that_begin_and_end_within_five_metres_are_one(apart: float, count: int) -> None:
    scene = straight_road().with_ego(x=50, speed=10)
    crowd = scene.with_pedestrian(55, y=-4.8).with_pedestrian(55 + apart, y=-4.8)
    verdict = run(crowd, Collision())
    assert len(verdict.infractions) == count
    assert verdict.contacts == 2


def test_who_is_left_out_counts_once_the_ego_has_left_the_circle_and_by_whose_fault_it_was_hit() -> None:
    scene = straight_road().with_ego(x=50, speed=10).with_pedestrian(55, y=-4.8)
    verdict = run(scene.with_pedestrian(59, 0.2, y=-4.8, heading=math.pi / 2), Collision())
    first, second = verdict.infractions
    assert (first.actor, second.actor) == ("actor0", "actor1")
    assert second.x_m - first.x_m == pytest.approx(5.0, abs=0.01)
    assert second.at_fault is True


def test_a_contact_that_was_counted_does_not_count_again_outside_the_circle() -> None:
    pushing = straight_road().with_ego(x=50, speed=5).with_actor(x=54.4, speed=5).with_actor(x=900)
    assert len(run(pushing, Collision(), seconds=10).infractions) == 1


def test_who_is_hit_again_within_the_circle_and_pushed_out_of_it_counts_twice() -> None:
    met = straight_road().with_ego(x=50, speed=1).with_actor(x=54.4).with_actor(x=900).worlds(seconds=0.3)
    apart = straight_road().with_ego(x=50).with_actor(x=70).with_actor(x=900).worlds(seconds=6, after=met[-1])
    pushed = straight_road().with_ego(x=50, speed=5).with_actor(x=54.4, speed=5).with_actor(x=900)
    worlds = [*met, *apart, *pushed.worlds(seconds=4, after=apart[-1])]
    assert len(run(worlds, Collision()).infractions) == 2
    assert len(run([*met, *apart], Collision()).infractions) == 1


@pytest.mark.parametrize(("away_m", "count"), [(3.0, 1), (20.0, 2)])
def test_a_place_that_was_hit_counts_again_once_the_ego_has_left_it(away_m: float, count: int) -> None:
    road = straight_road().with_ego(x=50, speed=10)
    lap = road.with_pedestrian(55, y=-4.8).with_pedestrian(900, y=-4.8).worlds(seconds=0.3 + away_m / 10)
    again = road.with_pedestrian(900, y=-4.8).with_pedestrian(55, y=-4.8)
    verdict = run([*lap, *again.worlds(seconds=0.5, after=lap[-1])], Collision())
    assert (len(verdict.infractions), verdict.contacts) == (count, 2)


def test_the_other_egos_contacts_are_not_ours() -> None:
    scene = straight_road().with_ego(x=50, speed=10).with_ego(x=200, speed=10).with_actor(x=60)
    verdict = run(scene, Collision(), ego=1)
    assert (verdict.infractions, verdict.contacts) == ([], 0)


angles = st.floats(-3.1, 3.1)
near = st.floats(-6.0, 6.0).map(lambda value: round(value, 2) + 0.0037)


@settings(max_examples=40, deadline=None)
@given(
    x=near,
    left=near,
    heading=angles,
    speed=st.floats(1.0, 15.0),
    ego_left=st.sampled_from([0.0, 0.9, 1.7]),
    shift=st.tuples(st.floats(-500, 500), st.floats(-500, 500), angles),
)
def test_a_verdict_does_not_depend_on_where_the_world_lies(
    x: float, left: float, heading: float, speed: float, ego_left: float, shift: tuple[float, float, float]
) -> None:
    scene = straight_road().with_ego(x=50, speed=6, left=ego_left)
    scene = scene.with_actor(x=50 + x, left=left, heading=heading, speed=speed)
    here, there = run(scene, Collision(), seconds=1.0), run(scene.transformed(*shift), Collision(), seconds=1.0)
    assert here.contacts == there.contacts
    assert [(one.time_s, one.at_fault) for one in here.infractions] == [
        (one.time_s, one.at_fault) for one in there.infractions
    ]
    for one, other in zip(here.infractions, there.infractions, strict=True):
        assert one.magnitude == pytest.approx(other.magnitude, abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(x=near, left=near, heading=angles)
def test_left_and_right_are_alike(x: float, left: float, heading: float) -> None:
    road = straight_road().with_ego(x=50, speed=6)
    one = run(road.with_actor(x=50 + x, left=left, heading=heading, speed=4), Collision())
    other = run(road.with_actor(x=50 + x, left=-left, heading=-heading, speed=4), Collision())
    assert [(a.time_s, a.at_fault) for a in one.infractions] == [(b.time_s, b.at_fault) for b in other.infractions]
