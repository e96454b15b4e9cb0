from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from dohyo.sumo_networks.envs.reward import RoachReward, make_reward
from dohyo.sumo_networks.errors import UnknownNameError
from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.world import ActorKind, LightState, World
from tests.lights import asking
from tests.worlds import Scene, crossing_for_pedestrians, lit_crossing, stop_sign_crossing, straight_road

SOUTH = -math.pi / 2
FREE = straight_road().with_ego(x=100.0, speed=6.0)


def reward(scene: Scene, name: str = "roach", ego: int = 0) -> tuple[float, bool]:
    before, after = scene.worlds(0.1)
    return make_reward(name)(before, after, ego)


def wish(scene: Scene) -> float:
    """The speed that an expert would drive, as a share of the highest."""
    return RoachReward().desired_speed(scene.world(), 0) / 6.0


def steered(world: World, angle: float) -> World:
    return dataclasses.replace(world, egos=dataclasses.replace(world.egos, steering=np.array([angle])))


# Roach, term by term


@pytest.mark.parametrize(("speed", "expected"), [(6.0, 1.0), (3.0, 0.5), (0.0, 0.0), (9.0, 0.5), (14.0, -1 / 3)])
def test_speed_counts_by_its_distance_from_the_desired_one(speed: float, expected: float) -> None:
    assert reward(straight_road().with_ego(x=100.0, speed=speed)) == (pytest.approx(expected), False)


@pytest.mark.parametrize("left", [-3.0, -1.0, 0.5, 3.4])
def test_half_of_the_lateral_distance_is_taken_off(left: float) -> None:
    assert reward(straight_road().with_ego(x=100.0, speed=6.0, left=left)) == (pytest.approx(1 - abs(left) / 2), False)


@pytest.mark.parametrize("heading", [-0.4, 0.3])
def test_the_heading_error_is_taken_off(heading: float) -> None:
    value, ended = reward(straight_road().with_ego(x=100.0, heading=heading))
    assert value == pytest.approx(-abs(heading))
    assert not ended


@pytest.mark.parametrize(("change", "cost"), [(0.009, 0.0), (0.011, 0.1), (-0.3, 0.1)])
def test_a_sudden_change_of_steering_costs_a_tenth(change: float, cost: float) -> None:
    before, after = FREE.worlds(0.1)
    value, _ = make_reward("roach")(steered(before, 0.1), steered(after, 0.1 + change), 0)
    assert value == pytest.approx(1.0 - cost)


@pytest.mark.parametrize(("left", "ended"), [(3.49, False), (3.51, True), (-3.51, True)])
def test_leaving_the_route_ends_the_episode_at_a_cost_of_one(left: float, ended: bool) -> None:
    value, over = reward(straight_road().with_ego(x=100.0, speed=6.0, left=left))
    assert over == ended
    assert value == pytest.approx(1 - abs(left) / 2 - ended)


def test_a_collision_costs_one_and_the_speed() -> None:
    scene = straight_road().with_ego(x=100.0, speed=5.0).with_actor(103.0)
    value, ended = reward(scene)
    assert ended
    # The car in front bids it stand, so the speed term is 1 - 5/6 from there.
    assert value == pytest.approx(1 - 5 / 6 - 1 - 5)


def test_only_the_egos_own_collisions_count() -> None:
    scene = FREE.with_ego(x=300.0).with_actor(302.0)
    assert reward(scene) == (pytest.approx(1.0), False)
    assert reward(scene, ego=1)[1]


@pytest.mark.parametrize(
    ("light", "ran"), [(LightState.RED, True), (LightState.YELLOW, False), (LightState.GREEN, False)]
)
def test_running_a_red_light_ends_the_episode(light: LightState, ran: bool) -> None:
    scene = lit_crossing()
    scene = scene.with_ego(x=scene.stop_line("w_c_0") - 2.25 - 0.3, speed=6.0).with_lights(light)
    value, ended = reward(scene)
    assert ended == ran
    assert value == pytest.approx(1 - (6.0 - 6.0 * wish(scene.with_lights(light))) / 6 - 7.0 * ran, abs=0.05)
    assert RoachReward(obey_lights=False)(*scene.worlds(0.1), 0) == (pytest.approx(1.0), False)


# Roach's desired speed


@pytest.mark.parametrize(("gap", "share"), [(20.0, 1.0), (9.4, 0.28), (9.0, 0.2), (8.0, 0.0), (5.0, 0.0)])
def test_a_car_ahead_slows_it_down(gap: float, share: float) -> None:
    assert wish(FREE.with_actor(100.0 + gap)) == pytest.approx(share)


@pytest.mark.parametrize(
    "place",
    [
        pytest.param({"x": 91.0}, id="behind"),
        pytest.param({"x": 102.0, "left": 6.0}, id="beside"),
        pytest.param({"x": 108.0, "left": 3.2, "heading": math.pi}, id="oncoming"),
    ],
)
def test_cars_elsewhere_do_not(place: dict[str, float]) -> None:
    assert wish(FREE.with_actor(**place)) == 1.0


@pytest.mark.parametrize(("gap", "share"), [(9.4, 0.68), (8.0, 0.4), (6.0, 0.0)])
def test_somebody_on_the_road_slows_it_down(gap: float, share: float) -> None:
    assert wish(FREE.with_pedestrian(100.0 + gap, y=-4.8)) == pytest.approx(share)


def test_somebody_on_a_crossing_does_and_on_a_sidewalk_does_not() -> None:
    scene = crossing_for_pedestrians().with_ego(x=-16.0, speed=6.0)
    assert wish(scene.with_pedestrian(-8.4, y=-4.8)) == pytest.approx((7.6 - 6.0) / 5)
    sidewalk = scene.with_pedestrian(-10.0, y=-7.0)
    world = sidewalk.world()
    lane = world.network.lane_index["w_c_0"]
    on_it = dataclasses.replace(world, actors=dataclasses.replace(world.actors, lane=np.array([lane])))
    off_lanes = dataclasses.replace(world, actors=dataclasses.replace(world.actors, lane=np.array([-1])))
    assert RoachReward().desired_speed(on_it, 0) == 6.0
    assert RoachReward().desired_speed(off_lanes, 0) < 6.0


@pytest.mark.parametrize("light", [LightState.RED, LightState.YELLOW])
@pytest.mark.parametrize(("distance", "share"), [(18.5, 1.0), (17.0, 1.0), (8.0, 0.6), (5.0, 0.0), (3.0, 0.0)])
def test_a_closed_light_slows_it_down(light: LightState, distance: float, share: float) -> None:
    scene = lit_crossing()
    scene = scene.with_ego(x=scene.stop_line("w_c_0") - distance, speed=6.0)
    assert wish(scene.with_lights(light)) == pytest.approx(share, abs=0.01)
    assert wish(scene.with_lights(LightState.GREEN)) == 1.0
    assert RoachReward(obey_lights=False).desired_speed(scene.with_lights(light).world(), 0) == 6.0


def test_a_stop_sign_slows_it_down_until_it_has_stood_there() -> None:
    scene, reward = stop_sign_crossing(), RoachReward()
    near = scene.with_ego(x=scene.stop_line("w_c_0") - 6.0, speed=2.0).world()
    standing = scene.with_ego(x=scene.stop_line("w_c_0") - 6.0, speed=0.0).world()
    assert reward.desired_speed(near, 0) == pytest.approx(6.0 * 0.2)
    assert reward.desired_speed(standing, 0) == 6.0
    assert reward.desired_speed(near, 0) == 6.0, "it has stood there"
    assert RoachReward(obey_lights=False).desired_speed(near, 0) == 6.0


def test_a_green_right_turn_arrow_slows_it_down_until_it_has_stood_there() -> None:
    scene, reward = lit_crossing().with_lights(LightState.OFF), RoachReward()
    near, standing = (scene.with_ego(x=scene.stop_line("w_c_0") - 6.0, speed=speed).world() for speed in (2.0, 0.0))
    assert reward.desired_speed(asking(near, w_c_0_s=RightOfWay.YIELD), 0) == 6.0
    assert reward.desired_speed(asking(near, w_c_0_s=RightOfWay.STOP), 0) == pytest.approx(6.0 * 0.2)
    assert reward.desired_speed(asking(standing, w_c_0_s=RightOfWay.STOP), 0) == 6.0
    assert reward.desired_speed(asking(near, w_c_0_s=RightOfWay.STOP), 0) == 6.0, "it has stood there"


def test_another_ego_slows_it_down_while_it_drives() -> None:
    world = FREE.with_ego(x=109.0).world()
    assert RoachReward().desired_speed(world, 0) == pytest.approx(0.2 * 6.0)
    assert RoachReward().desired_speed(world, 1) == 6.0
    retired = dataclasses.replace(world, egos=dataclasses.replace(world.egos, active=np.array([True, False])))
    assert RoachReward().desired_speed(retired, 0) == 6.0


def test_the_strictest_hazard_decides() -> None:
    scene = FREE.with_actor(109.0).with_pedestrian(107.0, y=-4.8)
    assert wish(scene) == pytest.approx(min((9.0 - 8.0) / 5, (7.0 - 6.0) / 5))
    assert wish(scene.with_actor(105.0, kind=ActorKind.STATIC)) == 0.0


# Progress


def test_progress_pays_per_metre_of_route() -> None:
    assert reward(FREE, "progress") == (pytest.approx(0.6), False)
    assert reward(straight_road().with_ego(x=100.0, speed=0.0), "progress") == (pytest.approx(0.0), False)


def test_progress_ends_at_a_contact_at_a_cost_of_ten() -> None:
    assert reward(FREE.with_actor(104.0), "progress") == (pytest.approx(0.6 - 10.0), True)


def test_an_unknown_reward_gets_the_nearest_name() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'progress'"):
        make_reward("progres")
