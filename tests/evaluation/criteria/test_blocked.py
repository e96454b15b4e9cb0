from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest

from dohyo.evaluation.criteria.blocked import Blocked
from dohyo.evaluation.criteria.collision import Collision
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.sumo_networks.world import ActorKind, EventPhase, EventState
from tests.worlds import Speed, kinds, run, straight_road


def standing(speed: Speed, seconds: float) -> list[InfractionKind]:
    return kinds(run(straight_road().with_ego(x=50, speed=speed), Blocked(), seconds=seconds))


@pytest.mark.parametrize(("seconds", "count"), [(179.9, 0), (180.1, 1), (190.0, 1)])
def test_standing_for_more_than_three_minutes_counts_once(seconds: float, count: int) -> None:
    assert standing(0.0, seconds) == [InfractionKind.BLOCKED] * count


@pytest.mark.parametrize("begin_s", [0.1, 0.2, 0.6, 1.0])
def test_three_minutes_are_the_same_from_whatever_tick_on(begin_s: float) -> None:
    assert standing(stops_after(begin_s - 0.05), begin_s + 180.0) == []
    assert standing(stops_after(begin_s - 0.05), begin_s + 180.1) == [InfractionKind.BLOCKED]


@pytest.mark.parametrize(("speed", "count"), [(0.09, 1), (0.1, 0)])
def test_creeping_at_a_tenth_of_a_metre_per_second_is_driving(speed: float, count: int) -> None:
    assert standing(speed, 185) == [InfractionKind.BLOCKED] * count


def test_a_short_move_starts_the_clock_anew() -> None:
    def nudges(time: float) -> float:
        return 1.0 if 99.95 < time < 100.15 else 0.0

    assert standing(nudges, 200) == []
    assert standing(nudges, 285) == [InfractionKind.BLOCKED]


def test_the_clock_starts_when_the_ego_stops() -> None:
    def drives_first(time: float) -> float:
        return 5.0 if time < 10 else 0.0

    assert standing(drives_first, 189.9) == []
    assert standing(drives_first, 190.3) == [InfractionKind.BLOCKED]


def test_the_infraction_says_for_how_long() -> None:
    (infraction,) = run(straight_road().with_ego(x=50), seconds=181).infractions
    assert (infraction.kind, infraction.unit) == (InfractionKind.BLOCKED, "s")
    assert infraction.magnitude == pytest.approx(180.1)


def test_it_ends_the_episode() -> None:
    assert InfractionKind.BLOCKED.specification.ends is Status.BLOCKED


def stops_after(seconds: float) -> Speed:
    return lambda time: 1.0 if time < seconds else 0.0


def test_a_queue_that_never_moves_again_is_a_gridlock_and_not_the_agents() -> None:
    scene = straight_road().with_ego(x=50).with_actor(x=55, speed=stops_after(3.0))
    (infraction,) = run(scene, Blocked(), seconds=185).infractions
    assert (infraction.kind, infraction.actor) == (InfractionKind.GRIDLOCK, "actor0")
    assert infraction.kind.specification.ends is Status.GRIDLOCK
    assert Status.GRIDLOCK.infrastructure_fault
    assert not Status.GRIDLOCK.worth_another_try


QUEUE = straight_road().with_ego(x=50).with_actor(x=55, speed=stops_after(3.0))


def test_a_queue_before_a_static_object_is_the_agents_to_pass() -> None:
    scene = QUEUE.with_actor(x=95, kind=ActorKind.STATIC)
    assert kinds(run(scene, Blocked(), seconds=185)) == [InfractionKind.BLOCKED]
    beside = QUEUE.with_actor(x=95, left=3.2, kind=ActorKind.STATIC)
    assert kinds(run(beside, Blocked(), seconds=185)) == [InfractionKind.GRIDLOCK]
    behind = QUEUE.with_actor(x=35, kind=ActorKind.STATIC)
    assert kinds(run(behind, Blocked(), seconds=185)) == [InfractionKind.GRIDLOCK]


@pytest.mark.parametrize(
    ("ego", "speed", "kind"),
    [
        (0, 0.0, InfractionKind.BLOCKED),
        (1, 0.0, InfractionKind.GRIDLOCK),  # of another ego's events
        (0, stops_after(3.0), InfractionKind.GRIDLOCK),  # a flow's vehicle, in the jam itself
    ],
)
def test_so_is_one_before_an_actor_of_its_own_events(ego: int, speed: Speed, kind: InfractionKind) -> None:
    worlds = QUEUE.with_actor(x=95, speed=speed).worlds(185)
    key = next(key for key in worlds[0].actors.key.tolist() if worlds[0].name_of(key) == "actor1")
    event = EventState("crash", "crash", ego, EventPhase.WAITING, math.nan, math.nan, (key,), math.nan)
    scripted = [dataclasses.replace(world, events=(event,)) for world in worlds]
    assert kinds(run(scripted, Blocked())) == [kind]


@pytest.mark.parametrize(
    ("distance_m", "speed", "kind"),
    [
        (60.0, 0.0, InfractionKind.BLOCKED),  # it may hold the queue up
        (60.0, 1.0, InfractionKind.GRIDLOCK),
        (300.0, 0.0, InfractionKind.GRIDLOCK),
    ],
)
def test_a_jam_in_which_another_ego_stands_may_be_made_by_agents(
    distance_m: float, speed: float, kind: InfractionKind
) -> None:
    scene = QUEUE.with_ego(x=50 + distance_m, speed=speed, left=3.2)
    assert kinds(run(scene, Blocked(), seconds=185)) == [kind]


@pytest.mark.parametrize(
    ("ahead_m", "left", "kind"),
    [
        (2.0, 0.9, InfractionKind.BLOCKED),  # beside the ego, which holds it up
        (2.0, 0.5, InfractionKind.BLOCKED),
        (3.6, 0.5, InfractionKind.GRIDLOCK),
    ],
)
def test_a_bicycle_beside_the_ego_is_no_queue(ahead_m: float, left: float, kind: InfractionKind) -> None:
    scene = straight_road().with_ego(x=50, left=-0.6)  # its front at 52.25
    behind = {"x": 50 + ahead_m - 3.0, "left": left, "speed": stops_after(3.0), "length": 1.7, "width": 0.6}
    bicycle = scene.with_actor(**behind, kind=ActorKind.BICYCLE)
    assert kinds(run(bicycle, Blocked(), seconds=185)) == [kind]


def test_an_ego_that_collided_may_have_made_the_jam_itself() -> None:
    def shoves(time: float) -> float:
        return 3.0 if time < 1.0 else 0.0

    scene = straight_road().with_ego(x=49.2, speed=shoves).with_actor(x=55, speed=stops_after(3.0))
    assert kinds(run(scene, Collision(), Blocked(), seconds=190)) == [
        InfractionKind.COLLISION_VEHICLE,
        InfractionKind.BLOCKED,
    ]


@pytest.mark.parametrize(
    "other",
    [
        {"x": 58.0, "speed": 0.0},  # never moved: parked
        {"x": 55.0, "speed": stops_after(70.0)},  # left 50 m ahead, then stopped far away
        {"x": 55.0, "speed": stops_after(3.0), "left": 3.2},  # beside it
        {"x": 42.0, "speed": stops_after(1.0)},  # behind it
        {"x": 61.0, "speed": stops_after(3.0), "heading": math.pi},  # came towards it
        {"x": 55.0, "speed": stops_after(3.0), "kind": ActorKind.PEDESTRIAN},
        {"x": 55.0, "speed": lambda time: 1.0 if 70.0 < time < 73.0 else 0.0},  # stood for less than two minutes
    ],
)
def test_any_other_standstill_is_the_agents(other: dict[str, Any]) -> None:
    scene = straight_road().with_ego(x=50).with_actor(**other)
    assert kinds(run(scene, Blocked(), seconds=185)) == [InfractionKind.BLOCKED]
