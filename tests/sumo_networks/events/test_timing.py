"""When scripted actors move: measured in the worlds that come of it."""

from __future__ import annotations

import itertools
import math

import libsumo
import numpy as np
import pytest

from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.world import ActorKind, EventPhase, World
from tests.conftest import MakeEnv
from tests.sumo_networks.events.stories import (
    EVENT,
    STORIES,
    Story,
    boxes_of,
    careful,
    drive,
    mission,
    over,
    rows_of,
    state,
    touched,
)
from tests.sumo_networks.simulation.drives import on, standing_at
from tests.worlds import straight_road

CROSSINGS = [
    "dynamic_object_crossing",
    "parking_crossing_pedestrian",
    "pedestrian_group_crossing",
    "cyclist_after_turn",
    "pedestrian_after_turn",
    "crossing_bicycle_flow",
]


def front_m(world: World) -> float:
    return float(world.egos.progress[0] + 0.5 * world.egos.length[0])


def on_route(world: World, name: str) -> tuple[float, float] | None:
    """Where an actor is along and beside the ego's route, m; None where it is out of sight."""
    rows = rows_of(world, name)
    if not rows:
        return None
    x, y = world.actors.position[rows[0]].tolist()
    s, left, _ = world.routes[0].project(x, y, 0.0, ahead=world.routes[0].length)
    return s, left


@pytest.mark.parametrize("kind", CROSSINGS)
def test_who_crosses_is_before_an_ego_that_keeps_its_speed(kind: str, make_env: MakeEnv) -> None:
    story = STORIES[kind]
    worlds = drive(make_env(story.scenario(), control="lane_command", reward=None), lambda _: story.speed, 60, over)
    places = [(world, on_route(world, "event:it-0")) for world in worlds]
    world, place = min(((w, p) for w, p in places if p is not None), key=lambda one: abs(one[1][1]))
    line = place[0]
    # In the tick in which it is in the middle of the ego's lane, the ego's front is there.
    assert abs(place[1]) <= 0.5
    assert front_m(world) == pytest.approx(line, abs=story.speed * 0.25 + 1.0)


@pytest.mark.parametrize("kind", ["dynamic_object_crossing", "pedestrian_group_crossing"])
def test_they_set_out_no_later_than_the_reaction_time_before(kind: str, make_env: MakeEnv) -> None:
    story = STORIES[kind]
    (event,) = story.scenario().events
    worlds = drive(make_env(story.scenario(), control="lane_command", reward=None), lambda _: story.speed, 60, over)
    walking = next(w for w in worlds if any(w.actors.speed[row] > 0.1 for row in rows_of(w, "event:it-0")))
    place = on_route(walking, "event:it-0")
    assert place is not None
    left_s = (place[0] - front_m(walking)) / story.speed
    assert event.reaction_time_s - 0.2 <= left_s <= event.reaction_time_s + 4.0  # type: ignore[union-attr]
    assert boxes_of(walking, "event:it-0").shape == (1, 5)
    assert walking.actors.speed[rows_of(walking, "event:it-0")[0]] == pytest.approx(event.speed_mps)  # type: ignore[union-attr]


def test_an_ego_that_creeps_up_sets_them_off_at_the_minimum_distance(make_env: MakeEnv) -> None:
    story = STORIES["dynamic_object_crossing"]
    env = make_env(story.scenario(), control="lane_command", reward=None)

    def creep(world: World) -> float:
        return 8.0 if world.egos.progress[0] < 40.0 else 0.9

    worlds = drive(env, creep, 60, until=over)
    walking = next(w for w in worlds if any(w.actors.speed[row] > 0.1 for row in rows_of(w, "event:it-0")))
    place = on_route(walking, "event:it-0")
    assert place is not None
    assert place[0] - front_m(walking) == pytest.approx(6.0, abs=0.3)


def test_nobody_walks_into_an_ego_that_stands(make_env: MakeEnv) -> None:
    story = STORIES["dynamic_object_crossing"]
    slowly = story.scenario(ahead_m=40.0, reaction_time_s=8.0, speed_mps=1.0, occluder="none")
    env, line = make_env(slowly, control="lane_command", reward=None), story.at_m + 40.0

    def hurries_onto_the_line(world: World) -> float:
        if not any(world.actors.speed[row] > 0.1 for row in rows_of(world)) and front_m(world) < line - 5.0:
            return 3.0
        return min(9.0, math.sqrt(max(6.0 * (line - float(world.egos.progress[0])), 0.0)))

    worlds = drive(env, hurries_onto_the_line, 40)
    assert abs(worlds[-1].egos.progress[0] - line) < 2.0
    assert worlds[-1].egos.speed[0] < 0.1
    assert touched(worlds) == []
    assert state(worlds[-1]).phase is EventPhase.ACTIVE  # they still wait for it to go
    assert worlds[-1].actors.speed[rows_of(worlds[-1])[0]] == 0.0


@pytest.mark.parametrize("kind", ["opposite_runs_red_light", "opposite_takes_priority"])
def test_the_rival_is_at_the_meeting_point_with_the_ego(kind: str, make_env: MakeEnv) -> None:
    story = STORIES[kind]
    worlds = drive(make_env(story.scenario(), control="lane_command", reward=None), lambda _: story.speed, 60, over)
    hit = next(world for world in worlds if touched([world]))
    row = rows_of(hit)[0]
    assert hit.actors.speed[row] == pytest.approx(60 / 3.6)
    assert worlds[-1].egos.speed[0] > 0.0
    before = [world for world in worlds if world.time < hit.time and rows_of(world)]
    gaps = [math.dist(world.actors.position[rows_of(world)[0]], hit.actors.position[row]) for world in before]
    assert all(a >= b - 0.01 for a, b in itertools.pairwise(gaps))  # it only ever comes nearer


def rival_of(env: DrivingEnv, cruise: float) -> list[tuple[float, float, int]]:
    """Speed [m/s], heading [rad] and indicator of the rival in each world in which it is to be seen."""
    worlds = drive(env, lambda _: cruise, 60, over)
    actors = [(world.actors, rows_of(world)[0]) for world in worlds if rows_of(world)]
    return [(float(a.speed[i]), float(a.heading[i]), int(a.indicator[i])) for a, i in actors]


def test_a_rival_that_turns_indicates_and_drives_no_faster_than_its_bend_allows(make_env: MakeEnv) -> None:
    from_the_stem = ("town-test", mission("-bridge_lane_1", 28.4, "-baker_street_3_1"))  # no way straight on meets it
    story = Story("opposite_runs_red_light", from_the_stem, 51.0)
    seen = rival_of(make_env(story.scenario(), control="lane_command", reward=None), story.speed)
    headings = np.unwrap([heading for _, heading, _ in seen])
    assert headings[-1] - headings[0] > 1.0
    assert {indicator for *_, indicator in seen[:-1]} == {1}
    turned = (headings[6:] - headings[:-6]) / 0.6
    lateral = np.array([speed for speed, *_ in seen[3:-3]]) * turned
    assert 2.0 < lateral.max() < 4.5


def test_a_rival_goes_straight_on_where_a_way_does(make_env: MakeEnv) -> None:
    crossing = ("district", mission("avenue_4_far_west_2", 198.7, "avenue_5_1"))  # left turns have a longer approach
    story = Story("opposite_runs_red_light", crossing, 115.6)
    seen = rival_of(make_env(story.scenario(), control="lane_command", reward=None), story.speed)
    headings = np.unwrap([heading for _, heading, _ in seen])
    assert np.ptp(headings) < 0.3
    assert {indicator for *_, indicator in seen} == {0}
    assert seen[-1][0] == pytest.approx(60 / 3.6)


def test_the_rival_waits_for_an_ego_that_stops_and_is_gone_in_the_end(make_env: MakeEnv) -> None:
    story = STORIES["opposite_takes_priority"]
    env = make_env(story.scenario(), control="lane_command", reward=None)
    worlds = drive(env, lambda world: story.speed if world.egos.progress[0] < 90.0 else 0.0, 40)
    assert touched(worlds) == []
    assert state(worlds[-1]).phase is EventPhase.ACTIVE
    went = drive(env, careful(story.speed), 60, until=over)
    assert state(went[-1]).phase is EventPhase.DONE


def test_the_lead_brakes_stands_and_drives_on(make_env: MakeEnv) -> None:
    story = STORIES["hard_brake"]
    env = make_env(story.scenario(), control="lane_command", reward=None)
    worlds = drive(env, careful(story.speed), 60, until=over)
    speeds = np.array([w.actors.speed[rows_of(w)[0]] if rows_of(w) else np.nan for w in worlds])
    rates = np.diff(speeds[~np.isnan(speeds)]) / 0.1
    assert rates.min() == pytest.approx(-8.0, abs=0.1)
    standing = np.flatnonzero(speeds == 0.0)
    assert 8.0 <= 0.1 * len(standing) <= 10.1
    after = drive(env, careful(story.speed), 8)
    assert max(after[-1].actors.speed[row] for row in rows_of(after[-1])) > 5.0


def test_the_vehicle_that_appears_comes_30_m_ahead_and_goes_10_s_later(make_env: MakeEnv) -> None:
    story = STORIES["vehicle_appears"]
    worlds = drive(make_env(story.scenario(), control="lane_command", reward=None), careful(story.speed), 40, over)
    there = [world for world in worlds if rows_of(world)]
    assert 30.0 - 0.2 <= story.at_m + 30.0 - there[0].egos.progress[0] <= 30.0 + 2.0
    assert there[-1].time - there[0].time == pytest.approx(10.0, abs=0.2)


def test_the_door_opens_only_before_the_ego(make_env: MakeEnv) -> None:
    story = STORIES["vehicle_opens_door"]
    worlds = drive(make_env(story.scenario(), control="lane_command", reward=None), lambda _: story.speed, 40, over)
    door = next(w for w in worlds if any(w.actors.kind[row] == ActorKind.STATIC for row in rows_of(w)))
    place = on_route(door, "event:it-1")
    assert place is not None
    assert (place[0] - front_m(door)) / story.speed == pytest.approx(2.0, abs=0.3)
    assert touched(worlds) == ["event:it-1"]


def test_no_door_opens_into_somebody_else(make_env: MakeEnv) -> None:
    # Another one drives 15 m before the ego, and is beside the door when the ego is 2 s away.
    story = STORIES["vehicle_opens_door"]
    alone = story.scenario()
    (own,) = alone.missions
    ahead = own.model_copy(update={"name": "ahead", "start": own.start.model_copy(update={"position_m": 20.0})})
    scenario = alone.model_copy(update={"missions": (own, ahead)})
    worlds = drive(make_env(scenario, control="lane_command", reward=None), lambda _: story.speed, 40, over)
    door = next(w for w in worlds if any(w.actors.kind[row] == ActorKind.STATIC for row in rows_of(w)))
    place = on_route(door, "event:it-1")
    assert place is not None
    assert door.egos.progress[1] + 15.0 - 2.25 > place[0] + 0.9, "the other one is past it"
    assert 0.0 < place[0] - front_m(door) < 1.5 * story.speed, "the ego is not"
    assert {contact.ego for world in worlds for contact in world.contacts} == {0}


def test_the_parked_car_moves_in_at_its_reaction_time(make_env: MakeEnv) -> None:
    story = STORIES["parking_cut_in"]
    worlds = drive(make_env(story.scenario(), control="lane_command", reward=None), lambda _: story.speed, 40, over)
    moving = next(w for w in worlds if any(w.actors.speed[row] > 0.1 for row in rows_of(w)))
    place = on_route(moving, "event:it-0")
    assert place is not None
    rear = place[0] - 2.3
    assert (rear - front_m(moving)) / story.speed == pytest.approx(2.35, abs=0.3)
    assert moving.actors.indicator[rows_of(moving)[0]] == 1


def test_oncoming_cars_enter_one_after_the_other_where_the_first_did(make_env: MakeEnv) -> None:
    # Further away the road may be another one.
    env = make_env(STORIES["invading_turn"].scenario(), control="lane_command", reward=None)
    worlds = drive(env, lambda world: 9.0 if world.egos.progress[0] < 120.0 else 0.0, 60, over)
    times, places = [], []
    for number in range(3):
        entered = next(world for world in worlds if rows_of(world, f"event:it-{number}"))
        times.append(entered.time)
        places.append(on_route(entered, f"event:it-{number}"))
    assert np.diff(times) == pytest.approx([2.5, 2.5], abs=0.31)  # the first is out of sight at first
    assert places[1] == pytest.approx(places[0], abs=2.5)
    assert places[2] == pytest.approx(places[0], abs=2.5)


def test_the_oncoming_car_goes_back_where_the_ego_brakes(make_env: MakeEnv) -> None:
    story = STORIES["oncoming_in_lane"]
    env = make_env(story.scenario(), control="lane_command", reward=None)

    def brakes(world: World) -> float:
        intruding = any(abs((on_route(world, "event:it-0") or (0, 9))[1]) < 2.5 for _ in rows_of(world))
        brakes.seen |= intruding  # type: ignore[attr-defined]
        return 0.0 if brakes.seen else story.speed  # type: ignore[attr-defined]

    brakes.seen = False  # type: ignore[attr-defined]
    worlds = drive(env, brakes, 40, until=over)
    assert brakes.seen  # type: ignore[attr-defined]
    assert touched(worlds) == []
    assert state(worlds[-1]).phase is EventPhase.DONE


class TestEmergency:
    """The vehicle with blue light."""

    def test_it_comes_from_140_m_behind_and_passes_an_ego_that_makes_room(self, make_env: MakeEnv) -> None:
        story = STORIES["yield_to_emergency_vehicle"]
        env = make_env(story.scenario(), control="lane_command", reward=None)

        def aside(world: World) -> tuple[float, float]:
            one = state(world)
            return (8.0, 1.0) if one.phase is EventPhase.ACTIVE and one.ahead > -80 else (12.0, 0.0)

        worlds = drive(env, aside, 90, until=over)
        active = [world for world in worlds if state(world).phase is EventPhase.ACTIVE]
        assert state(active[0]).ahead == pytest.approx(-140.0, abs=2.5)
        assert touched(worlds) == []
        assert state(worlds[-1]).ahead > 5.0
        (key,) = state(worlds[-1]).actors
        row = list(worlds[-1].actors.key).index(key)
        assert worlds[-1].actors.kind[row] == ActorKind.EMERGENCY

    @pytest.mark.parametrize("aside", [True, False])
    def test_a_car_beside_the_ego_holds_it_up_only_where_the_ego_is_in_its_way(
        self, aside: bool, make_env: MakeEnv
    ) -> None:
        event = EVENT.validate_python({"kind": "yield_to_emergency_vehicle", "name": "it", "at_m": 20, "behind_m": 100})
        env = make_env(on(straight_road(), standing_at(300.0), events=(event,)), control="lane_command", reward=None)
        env.reset()
        libsumo.route.add("vehicle-100", ["w_e"])
        place = {"departLane": "0" if aside else "1", "departPos": "410", "departSpeed": "0"}
        libsumo.vehicle.add("vehicle-100", "vehicle-100", "car", "now", **place)
        libsumo.vehicle.setSpeed("vehicle-100", 0.0)

        def stops_at_x_405(world: World) -> tuple[float, float]:
            to_go = 105.0 - float(world.egos.progress[0])
            return min(9.0, math.sqrt(max(4.0 * to_go, 0.0))), float(aside)

        worlds = drive(env, stops_at_x_405, 60, until=over)
        assert touched(worlds) == []
        assert state(worlds[-1]).phase is EventPhase.DONE
        assert (state(worlds[-1]).ahead > 5.0) == aside
        assert len(rows_of(worlds[-1], "vehicle-100")) == (0 if aside else 1), "removed only where it holds it up"

    def test_it_waits_behind_an_ego_that_does_not(self, make_env: MakeEnv) -> None:
        story = STORIES["yield_to_emergency_vehicle"]
        env = make_env(story.scenario(wait_s=10.0), control="lane_command", reward=None)
        worlds = drive(env, lambda _: 12.0, 90, until=over)
        assert touched(worlds) == []
        assert -25.0 < state(worlds[-1]).ahead < -5.0
        close = next(world for world in worlds if state(world).ahead > -25.0)
        assert worlds[-1].time - close.time == pytest.approx(10.0, abs=0.2)


def test_an_event_times_out_and_its_actors_leave(make_env: MakeEnv) -> None:
    story = STORIES["parked_obstacle"]
    env = make_env(story.scenario(timeout_s=15.0), control="lane_command", reward=None)
    worlds = drive(env, careful(story.speed), 60, until=over)
    assert state(worlds[-1]).phase is EventPhase.TIMED_OUT
    assert worlds[-1].time - state(worlds[-1]).started == pytest.approx(15.0)
    assert len(rows_of(worlds[-1])) == 1
    after = drive(env, lambda _: 0.0, 21.0)
    assert rows_of(after[-1]) == []
