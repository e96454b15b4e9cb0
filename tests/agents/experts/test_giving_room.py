"""The autopilot off the middle of its lane: round what blocks it, and out of others' way."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from pydantic import TypeAdapter

from dohyo.agents.experts.autopilot import _leader
from dohyo.agents.experts.blockers import Patience, find_blocker
from dohyo.agents.experts.courtesy import squeeze_past
from dohyo.agents.planning.sidestep import Sidestep
from dohyo.agents.planning.surroundings import Surroundings
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import run_episode
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.sumo_networks.events import Event
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from dohyo.sumo_networks.world import ActorKind, World
from tests.agents.driving import drive, fronts, made, observed, speeds, touched
from tests.sumo_networks.simulation.drives import on
from tests.worlds import Scene, lit_crossing, straight_road

WEST = math.pi


def lefts(worlds: list[World]) -> np.ndarray:
    """How far the ego is to the left of its route, m."""
    return np.array([world.egos.lateral[0] for world in worlds])


def blocked_road() -> Scene:
    """A building site in the ego's lane, 60 m ahead; the lane to the left is free."""
    return straight_road().with_ego(x=100.0, speed=8.0).with_actor(160.0, kind=ActorKind.STATIC, length=6.0, width=2.4)


# Where everybody is along the route


def test_neighbours_and_lanes_are_seen_along_the_route() -> None:
    scene = (
        straight_road()
        .with_ego(x=100.0)
        .with_actor(140.0, 5.0, left=3.2)
        .with_actor(180.0, 6.0, left=6.4, heading=WEST)
    )
    around = Surroundings(observed(made("Autopilot"), scene.world()))
    beside, oncoming = around.neighbours
    assert (beside.s_low + beside.s_high) / 2 == pytest.approx(40.0, abs=0.6)
    assert (beside.d_low + beside.d_high) / 2 == pytest.approx(3.2, abs=0.05)
    assert not beside.oncoming
    assert oncoming.oncoming
    (left,) = around.lanes_beside(0.0, 40.0)
    assert left.d == pytest.approx(3.2, abs=0.05)
    assert not left.oncoming


@pytest.mark.parametrize("x", [100.0, 100.3, 100.49, 100.51, 100.8])
def test_everybody_is_as_far_away_as_he_is(x: float) -> None:
    scene = straight_road().with_ego(x=x).with_actor(x + 40.0, 5.0, left=3.2).with_actor(x + 20.0, 5.0)
    driver = made("Autopilot")
    observation = observed(driver, scene.world())
    ahead, beside = Surroundings(observation).neighbours
    assert [0.5 * (one.s_low + one.s_high) for one in (ahead, beside)] == pytest.approx([20.0, 40.0], abs=0.02)
    gap, speed = _leader(observation["objects"], observation["route"], 1.2, 2.25)
    assert (gap, speed) == (pytest.approx(20.0 - 0.5 * (ahead.s_high - ahead.s_low) - 2.25, abs=0.02), 5.0)


def test_a_sidestep_lies_where_it_was_led_wherever_the_ego_is() -> None:
    aside = Sidestep()
    aside.lead(3.0, progress=20.0, ramp=12.0)
    for progress in (24.0, 24.3, 24.49, 24.51, 24.8):
        route = np.zeros((80, 7), dtype=np.float32)
        route[:, 0] = round(progress) - progress + np.arange(80)
        moved = aside.applied(route, progress)
        assert np.interp(4.0, progress + moved[:, 0] - 24.0, moved[:, 1]) == pytest.approx(aside.at(28.0), abs=0.01)


@pytest.mark.parametrize(("metres", "blocks"), [(1.9, True), (2.1, False)])
def test_what_reaches_into_a_junction_blocks_no_lane(metres: float, blocks: bool) -> None:
    scene = straight_road().with_ego(x=100.0).with_actor(120.0, kind=ActorKind.STATIC, length=4.0, width=1.8)
    junctions = np.full((4, 4), 1000.0, dtype=np.float32)
    junctions[0] = 22.0 - metres - 2.25, 40.0, -1.0, 0.0  # from the front; the obstacle ends at 22 m from the centre
    around = Surroundings(observed(made("Autopilot"), scene.world()))
    blocker, _ = find_blocker(around, junctions, Patience(), 1.2, 2.25, 2.25)
    assert (blocker is not None) == blocks


@pytest.mark.parametrize(("heading", "blocks"), [(0.3, True), (0.0, False)])
def test_a_crash_before_a_junction_is_no_queue(heading: float, blocks: bool) -> None:
    scene = straight_road().with_ego(x=100.0).with_actor(120.0, heading=heading)
    junctions = np.full((4, 4), 1000.0, dtype=np.float32)
    junctions[0] = 40.0, 60.0, -1.0, 0.0
    around = Surroundings(observed(made("Autopilot"), scene.world()))
    blocker, decided = find_blocker(around, junctions, Patience(), 1.2, 2.25, 2.25)
    assert ((blocker is not None), decided) == (blocks, blocks)


def test_a_sidestep_leads_out_and_back_without_a_jump() -> None:
    aside = Sidestep()
    aside.lead(3.0, progress=10.0, ramp=12.0)
    assert [aside.at(s) for s in (9.0, 16.0, 22.0, 50.0)] == pytest.approx([0.0, 1.5, 3.0, 3.0])
    aside.back(16.0)
    assert aside.at(16.0) == pytest.approx(1.5)
    assert aside.at(28.0) == 0.0


# Passing


def test_it_goes_round_a_building_site_and_back() -> None:
    worlds = drive(made("Autopilot"), blocked_road(), 25.0)
    assert touched(worlds) == set()
    assert fronts(worlds)[-1] > 200.0
    assert lefts(worlds).max() == pytest.approx(3.2, abs=0.4)
    assert abs(lefts(worlds)[-1]) < 0.2, "it is back in its lane"


def test_it_waits_until_the_lane_beside_is_free() -> None:
    scene = blocked_road()
    for x in range(20, 101, 10):
        scene = scene.with_actor(float(x), 8.0, left=3.2)
    worlds = drive(made("Autopilot"), scene, 40.0)
    assert touched(worlds) == set()
    out = next(i for i, left in enumerate(lefts(worlds)) if left > 1.5)
    last = min(worlds[out].actors.position[1:, 0])
    assert last > worlds[out].egos.position[0, 0] - 3.0, "nobody was still to come"
    assert fronts(worlds)[-1] > 200.0


def test_it_does_not_pass_who_was_just_driving() -> None:
    def stops(time: float) -> float:
        return max(8.0 - 3.0 * max(time - 1.0, 0.0), 0.0)

    worlds = drive(made("Autopilot"), straight_road().with_ego(x=100.0, speed=8.0).with_actor(125.0, stops), 15.0)
    assert abs(lefts(worlds)).max() < 0.2
    assert touched(worlds) == set()


def test_a_car_that_stands_on_an_open_road_is_no_queue() -> None:
    worlds = drive(made("Autopilot"), straight_road().with_ego(x=100.0, speed=8.0).with_actor(160.0), 22.0)
    assert touched(worlds) == set()
    assert fronts(worlds)[-1] > 175.0


def test_a_car_that_stands_behind_another_one_may_be_a_queue() -> None:
    scene = straight_road().with_ego(x=100.0, speed=8.0).with_actor(160.0).with_actor(182.0, 0.6)
    worlds = drive(made("Autopilot"), scene, 22.0)
    assert fronts(worlds)[-1] < 157.0


def test_it_breaks_off_for_who_changes_into_the_lane_beside() -> None:
    def changes(time: float) -> float:
        return -3.2 if 0.5 <= time < 1.5 else 0.0

    alone = straight_road().with_ego(x=130.0).with_actor(141.0, kind=ActorKind.STATIC, length=4.6, width=1.8)
    worlds = drive(made("Autopilot"), alone.with_actor(102.0, 12.0, left=6.4, drift=changes), 14.0)
    assert touched(worlds) == set()
    assert fronts(worlds)[-1] > 150.0, "it passes behind him"
    assert speeds(drive(made("Autopilot"), alone, 1.5))[-1] > 1.0, "alone it would be on its way by then"


def narrow_road(*gaps: float) -> Scene:
    """Both lanes to the east are blocked but for the left one, in which cars come at 12 m/s with these gaps [m]."""
    scene = straight_road().with_ego(x=140.0).with_actor(160.0, kind=ActorKind.STATIC, length=4.6, width=1.8)
    x = 170.0
    for gap in gaps:
        x += 4.6 + gap
        scene = scene.with_actor(x, 12.0, left=3.2, heading=WEST)
    return scene


def out_at(worlds: list[World]) -> float:
    """When the ego went into the lane beside, s."""
    return next((world.time for world, left in zip(worlds, lefts(worlds), strict=True) if left > 1.6), math.inf)


def test_it_waits_until_those_who_come_have_passed() -> None:
    worlds = drive(made("Autopilot"), narrow_road(20.0, 20.0, 20.0, 20.0), 30.0)
    assert touched(worlds) == set()
    last_passes = (170.0 + 4 * 24.6 - 150.0) / 12.0
    assert last_passes - 3.0 < out_at(worlds) < last_passes + 8.0


def test_it_moves_up_a_little_while_it_waits() -> None:
    scene = straight_road().with_ego(x=140.0)
    for left in (0.0, 3.2):
        scene = scene.with_actor(160.0, left=left, kind=ActorKind.STATIC, length=4.6, width=1.8)
    worlds = drive(made("Autopilot"), scene, 70.0)
    assert fronts(worlds)[200] + 0.2 < fronts(worlds)[-1] < 157.0
    assert touched(worlds) == set()


@pytest.mark.parametrize(
    ("left", "heading", "expected"),
    [
        pytest.param(2.0, WEST, 0.2, id="nose beside"),
        pytest.param(1.6, WEST, 0.6, id="nose in the way"),
        pytest.param(0.3, WEST, 0.0, id="no way round"),
        pytest.param(3.2, WEST, 0.0, id="in its own lane"),
        pytest.param(1.6, 0.0, 0.0, id="somebody of the same direction"),
    ],
)
def test_it_squeezes_past_who_faces_it(left: float, heading: float, expected: float) -> None:
    scene = straight_road().with_ego(x=100.0).with_actor(107.0, left=left, heading=heading)
    around = Surroundings(observed(made("Autopilot"), scene.world()))
    assert squeeze_past(around, 2.25, 0.9) == pytest.approx(expected, abs=0.03)


def test_it_keeps_to_its_lane_for_an_opened_door() -> None:
    scene = straight_road().with_ego(x=100.0, speed=8.0)
    scene = scene.with_actor(150.0, left=-1.1, kind=ActorKind.STATIC, length=0.15, width=1.0)
    worlds = drive(made("Autopilot"), scene, 20.0)
    assert touched(worlds) == set()
    assert 0.4 < lefts(worlds).max() < 1.2
    assert fronts(worlds)[-1] > 170.0


# Out of others' way


def test_it_stands_before_it_meets_somebody_in_its_own_lane() -> None:
    scene = straight_road().with_ego(x=100.0, speed=13.0).with_actor(180.0, 6.0, heading=WEST)
    worlds = drive(made("Autopilot"), scene, 8.0)
    meets = next((i for i, world in enumerate(worlds) if world.contacts), len(worlds) - 1)
    assert speeds(worlds)[meets] < 0.1


def test_those_who_come_in_their_own_lane_are_nothing_to_brake_for() -> None:
    scene = straight_road().with_ego(x=100.0, speed=13.0).with_actor(250.0, 10.0, left=3.2, heading=WEST)
    worlds = drive(made("Autopilot"), scene, 8.0)
    assert speeds(worlds).min() > 12.0


def test_it_keeps_right_of_who_comes_over_the_middle() -> None:
    scene = straight_road().with_ego(x=100.0, speed=10.0).with_actor(200.0, 8.0, left=1.7, heading=WEST)
    worlds = drive(made("Autopilot"), scene, 12.0)
    assert touched(worlds) == set()
    assert -0.75 < lefts(worlds).min() < -0.2
    assert abs(lefts(worlds)[-1]) < 0.15


def test_it_keeps_right_through_a_junction_while_they_come() -> None:
    mission = Mission(start=Place(lane="w_c_1"), goal=Place(lane="c_e_1", position_m=-1.0))
    scene = dataclasses.replace(lit_crossing(), mission=mission).with_ego(x=-70.0, speed=10.0)
    for x in range(-40, 120, 25):
        scene = scene.with_actor(float(x), 8.0, left=1.6, heading=WEST)
    worlds = drive(made("Autopilot"), scene, 14.0)
    assert touched(worlds) == set()
    assert fronts(worlds)[-1] > 20.0, "it has crossed the junction"


def test_it_lets_an_emergency_vehicle_pass() -> None:
    scene = straight_road().with_ego(x=200.0, speed=10.0)
    scene = scene.with_actor(110.0, 15.0, kind=ActorKind.EMERGENCY, length=6.5, width=2.2)
    worlds = drive(made("Autopilot"), scene, 25.0)
    assert touched(worlds) == set()
    assert lefts(worlds).max() > 2.5
    assert abs(lefts(worlds)[-1]) < 0.3, "then it goes back"


@pytest.mark.parametrize("speed", [5.0, 9.0, 13.0])
def test_it_waits_for_bicycles_that_cross_between_junctions(speed: float) -> None:
    scene = straight_road().with_ego(x=100.0, speed=speed)
    for number in range(3):
        y = -16.0 - 12.0 * number
        scene = scene.with_actor(150.0, 4.0, y=y, heading=math.pi / 2, kind=ActorKind.BICYCLE, length=1.7, width=0.6)
    worlds = drive(made("Autopilot"), scene, 25.0)
    assert touched(worlds) == set()
    assert fronts(worlds)[-1] > 170.0


# In SUMO, with scripted events


def infractions(scenario: Scenario) -> list[str]:
    """What went wrong in a drive of the autopilot, apart from being slow."""
    (drive,) = run_episode(scenario, {mission.name: made("Autopilot") for mission in scenario.missions}).egos
    assert drive.status in (Status.PERFECT, Status.COMPLETED)
    return [one.kind.value for one in drive.infractions if one.kind != InfractionKind.MINIMUM_SPEED]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["construction", "parked_obstacle", "yield_to_emergency_vehicle"])
def test_in_sumo_it_masters_an_event_on_a_road_with_two_lanes(kind: str) -> None:
    mission = Mission(start=Place(lane="w_e_0", position_m=200.0), goal=Place(lane="w_e_0", position_m=-250.0))
    event = TypeAdapter(Event).validate_python({"kind": kind, "name": "event", "at_m": 60.0})
    scenario = on(straight_road(), mission, events=(event,))
    assert infractions(scenario) == []


@pytest.mark.slow
def test_in_sumo_it_stands_before_it_meets_somebody_in_its_lane() -> None:
    scenarios = load_benchmark("precrash").scenarios([0])
    (scenario,) = (one for one in scenarios if one.name == "oncoming-in-lane.district.m01")
    assert infractions(scenario) == []
