from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.planning.prediction import constant_velocity
from dohyo.agents.planning.scene import HISTORY, SENSORS, Scene, SceneBuilder
from dohyo.agents.planning.warm_up import empty_road
from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import LightState, World
from tests.worlds import lit_crossing, stop_sign_crossing, straight_road


def observed(world: World) -> dict[str, np.ndarray]:
    return {sensor.name: sensor.read(world, 0) for sensor in make_sensors(SENSORS)}


def scenes(worlds: list[World]) -> list[Scene]:
    builder = SceneBuilder()
    return [builder.update(observed(world)) for world in worlds]


def test_histories_are_where_everybody_was_seen_from_here() -> None:
    scene = straight_road().with_ego(x=100.0, speed=10.0).with_actor(130.0, 4.0)
    last = scenes(scene.worlds(2.0))[-1]
    assert last.time == pytest.approx(2.0)
    # In 1.5 s the ego drove 15 m and the car 6 m; the car was 30 m ahead at first and is 18 m ahead now.
    np.testing.assert_allclose(last.actors.history[0, :, 0], [12.0, 14.0, 16.0, 18.0], atol=1e-3)
    np.testing.assert_allclose(last.ego.history[:, 0], [-15.0, -10.0, -5.0, 0.0], atol=1e-3)
    assert last.actors.history_valid.all()
    assert last.ego.history_valid.all()


def test_before_anybody_was_seen_histories_are_extrapolated_and_say_so() -> None:
    (first,) = scenes(straight_road().with_ego(x=100.0, speed=10.0).with_actor(130.0, 4.0).worlds(0.0))
    np.testing.assert_allclose(first.actors.history[0, :, 0], [24.0, 26.0, 28.0, 30.0], atol=1e-3)
    assert first.actors.history_valid[0].tolist() == [False] * (HISTORY - 1) + [True]


@pytest.mark.parametrize(("dx", "dy", "angle"), [(500.0, -300.0, 0.0), (0.0, 0.0, 1.0), (-80.0, 2000.0, -2.5)])
def test_where_the_world_lies_is_nothing_to_a_scene(dx: float, dy: float, angle: float) -> None:
    here = lit_crossing().with_ego(x=-60.0, speed=7.0, heading=0.1).with_actor(-30.0, 3.0)
    a, b = (scenes(scene.worlds(1.0))[-1] for scene in (here, here.transformed(dx, dy, angle)))
    np.testing.assert_allclose(a.actors.history, b.actors.history, atol=5e-3)
    np.testing.assert_allclose(a.path.position, b.path.position, atol=5e-3)
    assert len(a.lanes) == len(b.lanes)


def test_the_path_has_its_zero_at_the_ego() -> None:
    (scene,) = scenes(straight_road().with_ego(x=100.3, left=0.7).worlds(0.0))
    assert scene.path.lateral == pytest.approx(0.7, abs=1e-3)
    np.testing.assert_allclose(scene.path.position[:, 0], scene.path.s, atol=1e-3)
    assert scene.path.s[0] == pytest.approx(-12.0, abs=1.0)


def test_lanes_go_on_where_they_go_on() -> None:
    (scene,) = scenes(lit_crossing().with_ego(x=-60.0).worlds(0.0))
    lanes = scene.lanes
    joined = [(row, after) for row in range(len(lanes)) for after in lanes.following[row] if after >= 0]
    assert len(joined) > 20
    for row, after in joined:
        assert np.hypot(*(lanes.points[row, -1] - lanes.points[after, 0])) < 1.0
    assert set(lanes.on_route.tolist()) == {0, 1, 2}


def test_lanes_behind_a_red_light_are_red() -> None:
    (scene,) = scenes(lit_crossing().with_lights(LightState.RED, s=LightState.GREEN).with_ego(x=-40.0).worlds(0.0))
    red, inside = scene.lanes.red, scene.lanes.kind == 1
    assert red.any()
    assert (inside & ~red).any()
    assert not red[~inside].any()


@pytest.mark.parametrize(
    ("state", "speed", "closed"),
    [
        (LightState.RED, 8.0, True),
        (LightState.GREEN, 8.0, False),
        (LightState.YELLOW, 3.0, True),
        (LightState.YELLOW, 13.0, False),
    ],
)
def test_lines_are_closed_at_red_and_at_yellow_that_can_be_stopped_at(
    state: LightState, speed: float, closed: bool
) -> None:
    scene = lit_crossing().with_lights(state).with_ego(x=-32.0, speed=speed)
    (seen,) = scenes(scene.worlds(0.0))
    assert seen.stop_lines.closed[0] == closed
    assert seen.stop_lines.s[0] == pytest.approx(scene.stop_line("w_c_0") + 32.0, abs=0.3)


def test_a_stop_sign_opens_once_it_was_stood_at() -> None:
    line = stop_sign_crossing().stop_line("w_c_0")

    def speed(time: float) -> float:
        return 0.0 if time < 0.55 else 2.0

    worlds = stop_sign_crossing().with_ego(x=line - 4.0, speed=speed).worlds(1.0)
    closed = [bool(scene.stop_lines.closed[:1].any()) for scene in scenes(worlds)]
    assert not closed[-1]
    rolling = stop_sign_crossing().with_ego(x=line - 4.0, speed=1.0).worlds(0.5)
    assert all(bool(scene.stop_lines.closed[0]) for scene in scenes(rolling))


def test_a_stop_sign_opens_though_a_junction_comes_first() -> None:
    builder, closed = SceneBuilder(), []
    for front, speed in [(2.0, 0.0), (2.0, 2.0), (1.0, 2.0)]:
        observation = empty_road(SENSORS)
        observation["ego_state"][3] = speed
        observation["junctions_ahead"][:2] = [
            (front - 0.5, front - 0.2, -1.0, 0.0), (front, front + 12.0, -1.0, RightOfWay.STOP)
        ]  # fmt: skip
        closed.append(bool(builder.update(observation).stop_lines.closed[1]))
    assert closed == [False, False, False], "it has stood 2 m before the line"


def test_constant_velocity_goes_straight_on() -> None:
    (scene,) = scenes(straight_road().with_ego(x=100.0).with_actor(110.0, 5.0, heading=math.pi / 2).worlds(0.0))
    poses = constant_velocity(scene)
    np.testing.assert_allclose(poses[0, 80], [10.0, 40.0, math.pi / 2], atol=1e-4)
