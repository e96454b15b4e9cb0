from __future__ import annotations

import pytest

from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.scores.nocrash import drove, road_completed, success
from dohyo.evaluation.summary import score_drive
from tests.evaluation.builders import ego, infraction

COLLISIONS = (
    InfractionKind.COLLISION_PEDESTRIAN,
    InfractionKind.COLLISION_VEHICLE,
    InfractionKind.COLLISION_STATIC,
)


@pytest.mark.parametrize("kind", COLLISIONS)
@pytest.mark.parametrize("at_fault", [True, False, None])
def test_any_collision_fails_whoever_caused_it(kind: InfractionKind, at_fault: bool | None) -> None:
    assert not success(ego(infraction(kind, at_fault=at_fault), status=Status.COMPLETED))


@pytest.mark.parametrize("kind", [kind for kind in InfractionKind if kind not in COLLISIONS])
def test_no_other_infraction_fails(kind: InfractionKind) -> None:
    assert success(ego(infraction(kind), status=Status.COMPLETED))


def test_without_the_goal_there_is_no_success() -> None:
    assert success(ego(status=Status.PERFECT))
    assert not any(success(ego(status=status)) for status in Status if not status.completed)


def test_road_completed_ends_at_the_first_collision() -> None:
    late = infraction(InfractionKind.COLLISION_STATIC, time_s=50.0, route_m=700.0)
    early = infraction(InfractionKind.COLLISION_VEHICLE, time_s=20.0, route_m=300.0)
    assert road_completed(ego(late, early, status=Status.COMPLETED)) == pytest.approx(30.0)


def test_road_completed_without_collision_is_route_completion() -> None:
    assert road_completed(ego(infraction(InfractionKind.RED_LIGHT, route_m=100.0))) == pytest.approx(80.0)
    assert road_completed(ego(status=Status.COMPLETED, progress_m=998.0)) == 100.0


@pytest.mark.parametrize(("route_m", "expected"), [(-2.0, 0.0), (1003.0, 100.0)])
def test_road_completed_stays_in_its_range(route_m: float, expected: float) -> None:
    assert road_completed(ego(infraction(InfractionKind.COLLISION_STATIC, route_m=route_m))) == expected


@pytest.mark.parametrize(("hit_at", "far"), [(None, True), (2500.0, True), (2499.0, False)])
def test_2500_metres_are_counted_up_to_the_first_collision(hit_at: float | None, far: bool) -> None:
    hits = () if hit_at is None else (infraction(InfractionKind.COLLISION_VEHICLE, route_m=hit_at),)
    assert drove(ego(*hits, route_length_m=3000.0, progress_m=2600.0)) is far


def test_success_road_completed_and_2500_metres_are_three_numbers() -> None:
    one = ego(infraction(InfractionKind.COLLISION_VEHICLE, route_m=2700.0), route_length_m=3000.0, progress_m=2900.0)
    assert (success(one), road_completed(one), drove(one)) == (False, pytest.approx(90.0), True)


@pytest.mark.parametrize(
    ("outside_m", "counts"), [(0.0, True), (200.0, True), (201.0, True), (251.0, False), (800.0, False)]
)
def test_who_drives_beside_the_road_has_no_success(outside_m: float, counts: bool) -> None:
    one = ego(status=Status.COMPLETED, driven_m=800.0, outside_lanes_m=outside_m)
    assert success(one) is counts
    assert (score_drive(one)["success"], score_drive(one)["nocrash_success"]) == (100.0 * counts, 100.0 * counts)


@pytest.mark.parametrize(("outside_m", "far"), [(650.0, True), (651.0, False)])
def test_2500_metres_beside_the_road_are_none(outside_m: float, far: bool) -> None:
    assert drove(ego(route_length_m=3000.0, progress_m=2600.0, driven_m=9000.0, outside_lanes_m=outside_m)) is far
