from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest

from dohyo.agents.experts.autopilot import Autopilot
from dohyo.agents.planning.warm_up import empty_road
from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.settings import SettingsError
from dohyo.sumo_networks.scenario import Mission, Obstacle, Place, Traffic
from dohyo.sumo_networks.world import ActorKind, LightState
from tests.agents.driving import brakes_for_a_second_stop_sign, drive, fronts, made, observed, speeds, touched
from tests.conftest import MakeEnv
from tests.sumo_networks.simulation.drives import in_ingolstadt, on
from tests.worlds import Light, Scene, crossing_for_pedestrians, lit_crossing, stop_sign_crossing, straight_road

NORTH, SOUTH, WEST = math.pi / 2, -math.pi / 2, math.pi
RED, YELLOW, GREEN = LightState.RED, LightState.YELLOW, LightState.GREEN


def switching(at_s: float, before: LightState, after: LightState) -> Light:
    return lambda time: before if time < at_s else after


# Alone on the road


def test_on_a_free_road_it_drives_at_the_limit_in_the_middle_of_its_lane() -> None:
    worlds = drive(made("Autopilot"), straight_road().with_ego(x=50.0, left=0.8), 25.0)
    assert speeds(worlds).max() <= 13.89 + 0.2
    assert speeds(worlds)[-1] == pytest.approx(13.89, abs=0.3)
    assert abs(worlds[-1].egos.lateral[0]) < 0.1


def test_it_slows_down_for_a_bend_and_keeps_to_it() -> None:
    mission = Mission(start=Place(lane="w_c_1"), goal=Place(lane="c_n_1", position_m=-1.0))
    scene = dataclasses.replace(lit_crossing(), mission=mission).with_ego(x=-90.0, speed=13.0)
    worlds = drive(made("Autopilot"), scene, 16.0)
    assert worlds[-1].egos.progress[0] > 220.0, "it has turned"
    assert max(abs(world.egos.lateral[0]) for world in worlds) < 0.6
    turning = [i for i, world in enumerate(worlds) if 0.2 < world.egos.heading[0] < 1.4]
    assert speeds(worlds)[turning].max() < 8.5


def test_its_settings_are_those_of_its_style() -> None:
    entry = "dohyo.agents.experts.autopilot:Autopilot"
    worlds = drive(make_agent(entry, {"max_speed": 7.0}), straight_road().with_ego(x=50.0), 15.0)
    assert speeds(worlds)[-1] == pytest.approx(7.0, abs=0.2)
    with pytest.raises(SettingsError, match="did you mean 'max_speed'"):
        make_agent(entry, {"maximum_speed": 7.0})


# Lights and signs


@pytest.mark.parametrize("speed", [3.0, 8.0, 13.0])
def test_it_stops_before_a_red_light(speed: float) -> None:
    scene = lit_crossing().with_ego(x=-80.0, speed=speed).with_lights(RED)
    worlds = drive(made("Autopilot"), scene, 30.0)
    line = scene.stop_line("w_c_0")
    assert line - 3.0 < fronts(worlds).max() <= line
    assert speeds(worlds)[-1] < 0.05


def test_it_drives_on_when_the_light_turns_green() -> None:
    scene = lit_crossing().with_ego(x=-60.0, speed=8.0).with_lights(switching(15.0, RED, GREEN))
    worlds = drive(made("Autopilot"), scene, 30.0)
    assert fronts(worlds[:150]).max() <= scene.stop_line("w_c_0")
    assert fronts(worlds)[-1] > 20.0


def test_a_green_light_is_nothing_to_stop_for() -> None:
    worlds = drive(made("Autopilot"), lit_crossing().with_ego(x=-80.0, speed=13.0).with_lights(GREEN), 10.0)
    assert speeds(worlds).min() > 11.0


@pytest.mark.parametrize(("distance", "stops"), [(45.0, True), (12.0, False)])
def test_at_yellow_it_stops_where_it_comfortably_can(distance: float, stops: bool) -> None:
    scene = lit_crossing()
    line = scene.stop_line("w_c_0")
    scene = scene.with_ego(x=line - 2.25 - distance, speed=13.0).with_lights(switching(3.0, YELLOW, RED))
    worlds = drive(made("Autopilot"), scene, 8.0)
    assert (fronts(worlds)[-1] <= line) == stops
    crossed = next((world.time for world, x in zip(worlds, fronts(worlds), strict=True) if x > line), 0.0)
    assert crossed < 3.0


def test_at_a_stop_sign_it_stands_and_then_goes() -> None:
    scene = stop_sign_crossing().with_ego(x=-60.0, speed=10.0)
    worlds = drive(made("Autopilot"), scene, 30.0)
    line = scene.stop_line("w_c_0")
    near = (fronts(worlds) > line - 4.0) & (fronts(worlds) <= line)
    assert speeds(worlds)[near].min() < 0.1
    assert fronts(worlds)[-1] > 20.0


def test_it_brakes_for_a_stop_sign_behind_the_next_junction_until_it_has_stood_there() -> None:
    assert brakes_for_a_second_stop_sign(made("Autopilot"), straight_road().with_ego(x=100.0)) == [True, False, False]


# Others


@pytest.mark.parametrize("speed", [5.0, 13.0])
def test_it_stops_before_a_road_that_is_blocked(speed: float) -> None:
    scene = straight_road().with_ego(x=100.0, speed=speed)
    for left in (0.0, 3.2):
        scene = scene.with_actor(190.0, left=left, kind=ActorKind.STATIC, length=2.0, width=2.0)
    worlds = drive(made("Autopilot"), scene, 30.0)
    assert touched(worlds) == set()
    assert 189.0 - 12.0 < fronts(worlds)[-1] < 189.0 - 4.0, "with room to turn out"
    assert speeds(worlds)[-1] < 0.05


def test_it_passes_an_obstacle_beside_its_lane() -> None:
    scene = straight_road().with_ego(x=100.0, speed=10.0)
    worlds = drive(made("Autopilot"), scene.with_actor(150.0, left=3.2, kind=ActorKind.STATIC), 8.0)
    assert fronts(worlds)[-1] > 170.0
    assert speeds(worlds).min() > 9.0


def test_somebody_who_has_run_into_it_from_behind_is_no_leader() -> None:
    worlds = drive(made("Autopilot"), straight_road().with_ego(x=100.0, speed=0.0).with_actor(97.6, 0.0), 10.0)
    assert fronts(worlds)[-1] > 130.0


def test_it_follows_a_leader_that_brakes_hard() -> None:
    scene = straight_road().with_ego(x=100.0, speed=13.0)

    def braking(time: float) -> float:
        return max(13.0 - 6.0 * max(time - 2.0, 0.0), 0.0)

    worlds = drive(made("Autopilot"), scene.with_actor(128.0, braking), 15.0)
    assert touched(worlds) == set()
    assert speeds(worlds)[-1] < 0.05


def test_it_follows_a_slower_leader_at_its_speed() -> None:
    worlds = drive(made("Autopilot"), straight_road().with_ego(x=100.0, speed=13.0).with_actor(140.0, 6.0), 25.0)
    assert touched(worlds) == set()
    assert speeds(worlds)[-1] == pytest.approx(6.0, abs=0.3)
    gap = 140.0 + 6.0 * 25.0 - 2.25 - fronts(worlds)[-1]
    assert 6.0 < gap < 20.0


def test_it_gives_way_to_a_car_on_the_main_road() -> None:
    scene = stop_sign_crossing().with_ego(x=-30.0, speed=5.0)
    others = scene
    for y in range(-60, -160, -25):
        others = others.with_actor(4.8, 10.0, y=float(y), heading=NORTH)
    worlds = drive(made("Autopilot"), others, 30.0)
    assert touched(worlds) == set()
    last_passes = (158.0 - 4.8) / 10.0 - 3.0
    assert next(w.time for w, x in zip(worlds, fronts(worlds), strict=True) if x > 2.6) > last_passes
    alone = drive(made("Autopilot"), scene, 30.0)
    assert next(w.time for w, x in zip(alone, fronts(alone), strict=True) if x > 2.6) < last_passes
    assert fronts(worlds)[-1] > 10.0


def test_after_a_long_wait_it_merges_before_a_follower_who_has_to_brake_a_little() -> None:
    # It stands where its path joins a stream without end, in which somebody comes at 13 m/s.
    agent, observation = made("Autopilot"), empty_road(Autopilot.spec.sensors)
    observation["conflicts"][:] = -1.0

    def asked(metres: float) -> float:
        """Acceleration for one who is so far from where the paths join."""
        observation["conflicts"][0] = 1.5, 1000.0, metres, metres + 60.0, 13.0, 0.0, float(ActorKind.CAR), 7.0
        agent.act(observation)
        return float((agent.explain() or {})["acceleration"]["conflict"])

    waited = [asked(65.0) for _ in range(450)]
    assert max(waited[:100]) < 0.1
    assert math.inf in waited
    assert asked(25.0) < 0.1, "but never before one who is near"


def walking(y: float, speed: float, heading: float, at: float = -8.4) -> Scene:
    """Somebody who will walk across the western zebra, before a green light."""
    return crossing_for_pedestrians().with_lights(GREEN).with_pedestrian(at, speed, y=y, heading=heading)


@pytest.mark.parametrize("speed", [4.0, 8.0, 12.0])
@pytest.mark.parametrize(("y", "heading"), [(4.0, SOUTH), (-9.0, NORTH)])
def test_it_waits_for_somebody_on_the_crossing(speed: float, y: float, heading: float) -> None:
    worlds = drive(made("Autopilot"), walking(y, 1.3, heading).with_ego(x=-48.0, speed=speed), 20.0)
    assert touched(worlds) == set()
    assert fronts(worlds)[-1] > 0.0, "then it goes on"


def test_it_does_wait_rather_than_just_be_lucky() -> None:
    # Without braking its front would be on the crossing while the pedestrian is.
    walk = walking(6.0, 1.3, SOUTH).with_ego(x=-62.0, speed=7.0)
    worlds = drive(made("Autopilot"), walk, 20.0)
    alone = drive(
        made("Autopilot"), walk.with_lights(GREEN).__class__(walk.network, walk.mission).with_ego(-62.0, 7.0), 20.0
    )

    def reaches(drive: list) -> float:  # type: ignore[type-arg]
        return float(next(w.time for w, x in zip(drive, fronts(drive), strict=True) if x > -9.5))

    assert reaches(worlds) > reaches(alone) + 0.5
    assert touched(worlds) == set()


# What it says


@pytest.mark.parametrize(
    ("scene", "rule"),
    [
        pytest.param(straight_road().with_ego(x=50.0), "free road", id="nobody"),
        pytest.param(straight_road().with_ego(x=50.0, speed=10.0).with_actor(70.0, 3.0), "leader", id="leader"),
        pytest.param(straight_road().with_ego(x=50.0, speed=10.0).with_actor(70.0), "passing", id="parked"),
        pytest.param(lit_crossing().with_ego(x=-35.0, speed=10.0).with_lights(RED), "light", id="light"),
        pytest.param(
            stop_sign_crossing().with_ego(x=-12.9, speed=2.0).with_actor(4.8, 8.0, y=-20.0, heading=NORTH),
            ("conflict", "light"),
            id="conflict",
        ),
    ],
)
def test_it_says_which_rule_decided(scene: Scene, rule: str | tuple[str, ...]) -> None:
    agent = made("Autopilot")
    agent.reset(scene.mission, 0)
    action = agent.act(observed(agent, scene.world()))
    reason = agent.explain()
    assert reason is not None
    assert reason["rule"] in rule
    rules = {"free road", "leader", "light", "conflict", "passing", "oncoming", "emergency", "impact"}
    assert set(reason["acceleration"]) == rules
    assert action[0] == pytest.approx(max(min(min(reason["acceleration"].values()), 2.0), -8.0), abs=0.01)


def test_nothing_of_one_episode_survives_into_the_next() -> None:
    agent, scene = made("Autopilot"), stop_sign_crossing().with_ego(x=-60.0, speed=10.0)
    first = drive(agent, scene, 20.0)
    again = drive(agent, scene, 20.0)
    np.testing.assert_array_equal(fronts(again), fronts(first))


# In SUMO


def driven_in_sumo(make_env: MakeEnv, scenario, seconds: float):  # type: ignore[no-untyped-def]
    """All worlds of a drive of the autopilot."""
    agent = made("Autopilot")
    env = make_env(scenario, sensors=agent.spec.sensors, control=agent.spec.control, reward=None)
    observations, _ = env.reset()
    agent.reset(scenario.missions[0], 0)
    worlds = [env.world]
    while env.agents and env.world.time < seconds:
        observations = env.step({"ego": agent.act(observations["ego"])})[0]
        worlds.append(env.world)
    return worlds, env


def test_in_sumo_it_stops_before_a_red_light_and_drives_on_at_green(make_env: MakeEnv) -> None:
    mission = Mission(start=Place(lane="w_c_0", position_m=60.0), goal=Place(lane="c_e_0", position_m=-60.0))
    worlds, env = driven_in_sumo(make_env, on(lit_crossing(), mission), 130.0)
    assert env.agents == [], "it reached the goal"
    (passage,) = env.routes[0].passages
    line = lit_crossing().stop_line("w_c_0")
    i = int(np.flatnonzero(fronts(worlds) > line)[0])
    assert worlds[i].signals[passage.signal] != RED


def test_in_sumo_it_goes_round_an_obstacle(make_env: MakeEnv) -> None:
    mission = Mission(start=Place(lane="w_e_0", position_m=100.0), goal=Place(lane="w_e_0", position_m=-1.0))
    scenario = on(straight_road(), mission, obstacles=(Obstacle(x_m=200.0, y_m=-4.8),))
    worlds, _ = driven_in_sumo(make_env, scenario, 25.0)
    assert touched(worlds) == set()
    assert fronts(worlds)[-1] > 220.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_in_sumo_it_drives_through_traffic_into_nobody(seed: int, make_env: MakeEnv) -> None:
    traffic = Traffic(vehicles=20, pedestrians=30, warm_up_s=10.0)
    worlds, env = driven_in_sumo(make_env, in_ingolstadt(traffic=traffic, seed=seed), 60.0)
    assert worlds[-1].egos.progress[0] > 150.0
    assert max(len(world.actors) for world in worlds) > 5
    for before, after in pairwise(worlds):
        # Those who wait behind it in a junction may lose patience and push; it drives into nobody itself.
        assert not (after.contacts and before.egos.speed[0] >= 0.1)
        start, end = before.egos.progress[0] + 2.25, after.egos.progress[0] + 2.25
        for passage in env.routes[0].passages:
            if start < passage.entry <= end and passage.signal >= 0:
                assert after.signals[passage.signal] != RED
