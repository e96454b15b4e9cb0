"""The types of scenario: what is of a type and what, just beyond a threshold, is not."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.evaluation.authoring.scenario_types import TYPES, Run
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.scenario import Mission, Place
from dohyo.sumo_networks.simulation.traffic_log import LogRecorder
from dohyo.sumo_networks.world import ActorKind, LightState
from tests.worlds import Scene, Speed, lit_crossing, straight_road


def run_of(scene: Scene, seconds: float = 15.0, mission: Mission | None = None) -> Run:
    recorder, worlds = LogRecorder(), scene.worlds(seconds)
    for world in worlds:
        recorder.append([world.names[key] for key in world.actors.key], world.actors, world.signals)
    egos = [world.egos for world in worlds]
    route = plan_route(scene.network, mission or scene.mission)
    columns = [
        np.array([getattr(one, name)[0] for one in egos]) for name in ("heading", "speed", "position", "progress")
    ]
    return Run(scene.network, route, recorder.finish(), *columns)


def types(scene: Scene, seconds: float = 15.0) -> set[str]:
    run = run_of(scene, seconds)
    return {name for name, test in TYPES.items() if test(run)}


def ego(speed: Speed, x: float = 100.0) -> Scene:
    return straight_road().with_ego(x=x, speed=speed)


def braking(from_mps: float, deceleration: float) -> Speed:
    return lambda t: max(from_mps - deceleration * t, 0.0)


def test_there_are_the_fourteen() -> None:
    assert len(TYPES) == 14
    assert "starting-straight-traffic-light-intersection-traversal" in TYPES


def test_an_empty_road_at_a_medium_speed_is_of_no_type() -> None:
    assert types(ego(8.0)) == set()


@pytest.mark.parametrize(("speed", "expected"), [(9.1, True), (8.9, False)])
def test_high_magnitude_speed(speed: float, expected: bool) -> None:
    assert ("high-magnitude-speed" in types(ego(speed))) is expected


@pytest.mark.parametrize(("speed", "expected"), [(0.25, False), (0.35, True), (1.15, True), (1.25, False)])
def test_low_magnitude_speed(speed: float, expected: bool) -> None:
    assert ("low-magnitude-speed" in types(ego(speed))) is expected


@pytest.mark.parametrize(("gap", "speed", "expected"), [(8.0, 6.0, True), (12.0, 6.0, False), (8.0, 3.5, False)])
def test_stopping_with_lead(gap: float, speed: float, expected: bool) -> None:
    way = speed**2 / 4.0
    scene = ego(braking(speed, 2.0)).with_actor(x=100 + way + 4.5 + gap)
    assert ("stopping-with-lead" in types(scene)) is expected


def test_a_car_in_the_next_lane_is_no_lead() -> None:
    assert "stopping-with-lead" not in types(ego(braking(6.0, 2.0)).with_actor(x=118, left=3.2))


@pytest.mark.parametrize(("gap", "length", "expected"), [(18.0, 9.5, True), (22.0, 9.5, False), (18.0, 7.0, False)])
def test_behind_long_vehicle(gap: float, length: float, expected: bool) -> None:
    truck = {"kind": ActorKind.TRUCK, "length": length, "width": 2.5}
    scene = ego(8.0).with_actor(x=102.25 + gap + length / 2, speed=8.0, **truck)  # type: ignore[arg-type]
    assert ("behind-long-vehicle" in types(scene)) is expected


@pytest.mark.parametrize(("gap", "speed", "expected"), [(25.0, 5.0, True), (35.0, 5.0, False), (25.0, 3.0, False)])
def test_following_lane_with_lead(gap: float, speed: float, expected: bool) -> None:
    scene = ego(speed).with_actor(x=104.5 + gap, speed=speed)
    assert ("following-lane-with-lead" in types(scene)) is expected


@pytest.mark.parametrize(("others", "expected"), [(3, True), (2, False)])
def test_stationary_in_traffic(others: int, expected: bool) -> None:
    scene = ego(0.0)
    for i in range(others):
        scene = scene.with_actor(x=108 + 7 * i)
    assert ("stationary-in-traffic" in types(scene)) is expected


@pytest.mark.parametrize(("others", "speed", "expected"), [(4, 3.0, True), (3, 3.0, False), (4, 1.5, False)])
def test_near_multiple_vehicles(others: int, speed: float, expected: bool) -> None:
    scene = ego(speed)
    for i in range(others):
        scene = scene.with_actor(x=88 + 7 * i, speed=speed, left=3.2)
    assert ("near-multiple-vehicles" in types(scene)) is expected


@pytest.mark.parametrize(("left", "expected"), [(-2.5, True), (-1.5, False), (2.5, False), (-5.5, False)])
def test_traversing_pickup_dropoff(left: float, expected: bool) -> None:
    assert ("traversing-pickup-dropoff" in types(ego(8.0).with_actor(x=140, left=left))) is expected


def test_a_car_at_the_kerb_that_drives_off_or_is_not_passed_is_no_pickup() -> None:
    assert "traversing-pickup-dropoff" not in types(ego(8.0).with_actor(x=140, speed=1.0, left=-2.5))
    assert "traversing-pickup-dropoff" not in types(ego(2.0).with_actor(x=160, left=-2.5))


@pytest.mark.parametrize(("ahead", "aside", "expected"), [(12.0, 2.0, True), (18.0, 2.0, False), (12.0, 4.0, False)])
def test_waiting_for_pedestrian_to_cross(ahead: float, aside: float, expected: bool) -> None:
    scene = ego(0.0).with_pedestrian(102.25 + ahead, y=straight_road().route.position[0, 1] + aside)
    assert ("waiting-for-pedestrian-to-cross" in types(scene)) is expected


@pytest.mark.parametrize(("x", "speed", "expected"), [(-30, 8.0, True), (-80, 8.0, False), (-15, 1.0, False)])
def test_straight_through_a_light(x: float, speed: float, expected: bool) -> None:
    scene = lit_crossing().with_ego(x=x, speed=speed).with_lights(LightState.GREEN)
    name = "starting-straight-traffic-light-intersection-traversal"
    assert (name in types(scene, 8.0)) is expected


def turned(angle: float, speed: float, goal: str) -> set[str]:
    """An ego that turns by an angle within 3 s, on a route through the crossing."""
    lane = "w_c_1" if goal == "c_n_1" else "w_c_0"
    mission = Mission(start=Place(lane=lane), goal=Place(lane=goal, position_m=-1.0))
    run = run_of(lit_crossing().with_ego(x=-25, speed=speed), 8.0, mission)
    heading = np.clip(np.arange(len(run.speed)) / 30.0, 0, 1) * angle
    turn = Run(run.network, run.route, run.log, heading, run.speed, run.position, run.progress)
    return {name for name, test in TYPES.items() if test(turn)}


@pytest.mark.parametrize(("angle", "expected"), [(1.5, True), (0.7, False), (-1.5, False)])
def test_turns(angle: float, expected: bool) -> None:
    assert ("starting-left-turn" in turned(angle, 6.0, "c_n_1")) is expected
    assert ("starting-right-turn" in turned(-angle, 6.0, "c_s_0")) is expected


@pytest.mark.parametrize(("speed", "expected"), [(3.2, True), (2.6, False)])
def test_high_lateral_acceleration(speed: float, expected: bool) -> None:
    """1.5 rad in 3 s is 0.5 rad/s, which is 1.5 m/s^2 at 3 m/s."""
    assert ("high-lateral-acceleration" in turned(1.5, speed, "c_n_1")) is expected


@pytest.mark.parametrize(("speed", "expected"), [(8.0, True), (1.0, False)])
def test_changing_lane(speed: float, expected: bool) -> None:
    goal = Place(lane="w_e_1", position_m=160.0)
    mission = Mission(start=Place(lane="w_e_0", position_m=100.0), goal=goal)
    run = run_of(ego(speed), 15.0, mission)
    change = plan_route(straight_road().network, mission).lane_changes[0]
    assert change.start <= 60.0
    moved = Run(run.network, run.route, run.log, run.heading, run.speed, run.position, run.progress - run.progress[0])
    assert TYPES["changing-lane"](moved) is expected
