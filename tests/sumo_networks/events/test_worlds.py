"""Scripted actors in the world and in SUMO: like any other actor, and the same every time."""

from __future__ import annotations

import dataclasses
import hashlib

import libsumo
import numpy as np
import pytest

from dohyo.sumo_networks.events.auto_events import auto_events
from dohyo.sumo_networks.geometry import boxes_overlap
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.world import ActorKind, EventPhase, World
from tests.conftest import MakeEnv
from tests.sumo_networks.events.stories import (
    COUNTRY,
    EVENT,
    STORIES,
    boxes_of,
    careful,
    drive,
    over,
    route_of,
    rows_of,
    state,
)

TRAFFIC = Traffic(vehicles=25, bicycles=3, pedestrians=10, warm_up_s=5.0)


def actors_of(world: World) -> set[str]:
    return {world.names[key] for key in world.actors.key}


def digest(worlds: list[World]) -> str:
    total = hashlib.sha256()
    for world in worlds:
        for part in (world.egos, world.actors):
            for field in dataclasses.fields(part):
                value = getattr(part, field.name)
                total.update(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
        total.update(repr(world.events).encode())
    return total.hexdigest()


def eventful(seed: int = 1) -> Scenario:
    events = auto_events(load_network(COUNTRY[0]), route_of(*COUNTRY), seed, every_m=(60.0, 90.0))
    return Scenario(network=COUNTRY[0], missions=(COUNTRY[1],), traffic=TRAFFIC, events=events[:5], seed=seed)


def test_the_same_scenario_gives_the_same_worlds(make_env: MakeEnv) -> None:
    def played() -> str:
        return digest(drive(make_env(eventful(), control="lane_command", reward=None), careful(9.0), 60))

    assert played() == played()


def test_an_env_that_is_reset_plays_the_events_again(make_env: MakeEnv) -> None:
    env = make_env(STORIES["hard_brake"].scenario(), control="lane_command", reward=None)
    first = drive(env, lambda _: 9.0, 20)
    env.reset()
    assert digest(drive(env, lambda _: 9.0, 20)) == digest(first)


def test_events_do_not_change_the_traffic_that_they_do_not_meet(make_env: MakeEnv) -> None:
    scenario = eventful()
    late = EVENT.validate_python({"kind": "hard_brake", "name": "late", "at_m": 1000.0})
    worlds = []
    for events in ((), (late,)):
        changed = scenario.model_copy(update={"events": events})
        worlds.append(drive(make_env(changed, control="lane_command", reward=None), lambda _: 5.0, 15))
    for a, b in zip(*worlds, strict=True):
        np.testing.assert_array_equal(a.actors.boxes(), b.actors.boxes())
    assert worlds[0][-1].events == ()
    assert state(worlds[1][-1]).phase is EventPhase.WAITING


def test_actors_are_rows_in_the_order_of_keys(make_env: MakeEnv) -> None:
    worlds = drive(make_env(eventful(), control="lane_command", reward=None), careful(9.0), 40)
    assert any(rows_of(world) for world in worlds)
    for world in worlds:
        assert (np.diff(world.actors.key) > 0).all()
        assert np.isfinite(world.actors.boxes()).all()
        distance = np.hypot(*(world.actors.position - world.egos.position[0]).T)
        assert (distance <= 100.0 + 10.0).all()  # SUMO measures from the front bumper
        assert (np.abs(world.actors.heading) <= np.pi + 1e-9).all()


@pytest.mark.parametrize(
    ("kind", "kinds"),
    [
        ("dynamic_object_crossing", {ActorKind.PEDESTRIAN, ActorKind.STATIC}),
        ("parking_crossing_pedestrian", {ActorKind.PEDESTRIAN, ActorKind.CAR}),
        ("cyclist_after_turn", {ActorKind.BICYCLE}),
        ("construction_two_ways", {ActorKind.STATIC, ActorKind.CAR}),
        ("accident", {ActorKind.CAR}),
    ],
)
def test_actors_are_what_they_are(kind: str, kinds: set[ActorKind], make_env: MakeEnv) -> None:
    story = STORIES[kind]
    worlds = drive(make_env(story.scenario(), control="lane_command", reward=None), careful(story.speed), 40, over)
    assert {ActorKind(world.actors.kind[row]) for world in worlds for row in rows_of(world)} == kinds


def test_the_size_of_an_actor_is_what_the_event_says(make_env: MakeEnv) -> None:
    scenario = STORIES["vehicle_appears"].scenario(actor="truck", length_m=11.0, width_m=2.6)
    worlds = drive(make_env(scenario, control="lane_command", reward=None), careful(9.0), 30, over)
    (box,) = {tuple(world.actors.boxes()[row, 3:]) for world in worlds for row in rows_of(world)}
    assert box == (11.0, 2.6)


def test_sumos_own_cars_stop_for_who_crosses_their_lane(make_env: MakeEnv) -> None:
    """Someone crosses slowly from the left, through the lane of the cars that come past a building site."""
    walker = EVENT.validate_python(
        {"kind": "dynamic_object_crossing", "name": "walker", "at_m": 100.0, "side": "left", "speed_mps": 0.4}
    )
    cars = EVENT.validate_python({"kind": "construction_two_ways", "name": "cars", "at_m": 130.0})
    scenario = Scenario(network=COUNTRY[0], missions=(COUNTRY[1],), events=(walker, cars))
    env = make_env(scenario, control="lane_command", reward=None)
    worlds = drive(env, lambda world: 9.0 if world.egos.progress[0] < 110.0 else 0.0, 45)
    stopped = False
    for world in worlds:
        on_foot = boxes_of(world, "event:walker-0")
        for box, row in zip(boxes_of(world, "event:cars-flow"), rows_of(world, "event:cars-flow"), strict=True):
            near = len(on_foot) > 0 and np.hypot(*(on_foot[0, :2] - box[:2])) < 15.0
            stopped |= bool(near and world.actors.speed[row] < 0.2)
            if len(on_foot):
                assert not boxes_overlap(on_foot, box[None])[0, 0]
    assert stopped


def test_two_egos_have_their_own_events(make_env: MakeEnv) -> None:
    first = COUNTRY[1].model_copy(update={"name": "first"})
    second = Mission(name="second", start=Place(lane="hill_road_2_1", position_m=45.0), goal=first.goal)
    events = tuple(
        EVENT.validate_python({"kind": "vehicle_appears", "name": f"of-{name}", "ego": name, "at_m": at})
        for name, at in (("first", 150.0), ("second", 20.0))
    )
    scenario = Scenario(network="district", missions=(first, second), events=events)
    env = make_env(scenario, control="lane_command", reward=None)
    env.reset()
    for _ in range(80):
        env.step({"first": np.zeros(2, np.float32), "second": np.array([6.0, 0.0], np.float32)})
    phases = {event.name: (event.ego, event.phase) for event in env.world.events}
    assert phases == {"of-first": (0, EventPhase.WAITING), "of-second": (1, EventPhase.ACTIVE)}
    env.retire("second")
    env.step({"first": np.zeros(2, np.float32)})
    assert env.world.events[1].phase is EventPhase.DONE


@pytest.mark.parametrize(("at_m", "phase"), [(0.0, EventPhase.DONE), (30.0, EventPhase.WAITING)])
@pytest.mark.parametrize(("apart_m", "stays_s"), [(20.0, 20.0), (150.0, 0.0)])
def test_actors_leave_another_egos_sight_as_always_when_their_own_ego_has_left(
    at_m: float, phase: EventPhase, apart_m: float, stays_s: float, make_env: MakeEnv
) -> None:
    first = COUNTRY[1].model_copy(update={"name": "first"})
    second = Mission(name="second", start=Place(lane="hill_road_2_1", position_m=5.0 + apart_m), goal=first.goal)
    parked = {"kind": "parked_obstacle_two_ways", "name": "it", "ego": "second", "at_m": at_m, "ahead_m": 40.0}
    event = EVENT.validate_python(parked)
    scenario = Scenario(network="district", missions=(first, second), events=(event,))
    env = make_env(scenario, control="lane_command", reward=None)
    env.reset()
    env.step(dict.fromkeys(("first", "second"), np.zeros(2, np.float32)))
    env.retire("second")
    there = []
    for _ in range(220):
        env.step({"first": np.zeros(2, np.float32)})
        there.append("event:it-0" in actors_of(env.world))
    assert state(env.world).phase is phase
    assert sum(there) == pytest.approx(10 * stays_s, abs=2)
    assert there == sorted(there, reverse=True)


def test_traffic_passes_a_crash_in_the_lane_beside(make_env: MakeEnv) -> None:
    # The crashed cars stand askew, and reach to the edges of their lane.
    way = Mission(start=Place(lane="avenue_3_far_west_2", position_m=5.0), goal=Place(lane="avenue_3_near_west_2"))
    crash = EVENT.validate_python({"kind": "accident_two_ways", "name": "it", "at_m": 60.0})
    env = make_env(Scenario(network="district", missions=(way,), events=(crash,)), control="lane_command", reward=None)
    drive(env, lambda _: 8.0, 60, lambda world: float(world.egos.progress[0]) > 30.0)
    assert rows_of(env.world)
    libsumo.route.add("straight on", ["avenue_3_far_west", "avenue_3_near_west"])
    libsumo.vehicle.add("beside", "straight on", "car", departLane="1", departPos="60", departSpeed="8")
    drive(env, lambda _: 0.0, 25)
    assert "beside" not in libsumo.vehicle.getIDList() or libsumo.vehicle.getDistance("beside") > 120.0
