"""Nearby: distances, strips and junctions of hand-made worlds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.hierarchical.state.nearby import SENSORS, actors_near, crossings, distances, junctions, root, strips
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import ActorKind, LightState
from tests.worlds import Scene, lit_crossing, stop_sign_crossing, straight_road

HALF_M = 2.25


def seen(scene: Scene) -> dict[str, np.ndarray]:
    world = scene.world()
    return {sensor.name: sensor.read(world, 0) for sensor in make_sensors(SENSORS)}


def ego(x: float = 100.0, **more: float) -> Scene:
    return straight_road().with_ego(x=x, speed=8.0, **more)


def test_nobody_and_nothing_ahead_is_as_far_as_can_be() -> None:
    assert distances(seen(ego())).tolist() == [50.0, 50.0]


@pytest.mark.parametrize("x", [100.0, 100.3, 100.5, 100.9])
def test_an_impact_is_as_far_as_from_bumper_to_bumper(x: float) -> None:
    impact, _ = distances(seen(ego(x).with_actor(x=x + 20.0)))
    assert impact == pytest.approx(20.0 - 2 * HALF_M, abs=0.01)


def test_the_nearest_in_the_way_counts() -> None:
    scene = ego().with_actor(x=140.0).with_pedestrian(x=115.0, y=-4.8).with_actor(x=130.0)
    assert distances(seen(scene))[0] == pytest.approx(15.0 - HALF_M - 0.15, abs=0.01)


@pytest.mark.parametrize(("left", "hit"), [(0.0, True), (2.0, True), (2.2, False), (-2.2, False), (3.2, False)])
def test_who_is_beside_the_way_is_no_impact(left: float, hit: bool) -> None:
    """Half of the ego's width and of the other's, and 0.3 m: 2.1 m."""
    assert bool(distances(seen(ego().with_actor(x=120.0, left=left)))[0] < 50.0) is hit


def test_who_is_behind_is_no_impact() -> None:
    assert distances(seen(ego().with_actor(x=90.0)))[0] == 50.0


def test_an_event_is_as_far_as_the_stop_line_and_here_inside_the_junction() -> None:
    line = lit_crossing().stop_line("w_c_0")
    before = lit_crossing().with_ego(x=line - 30.0)
    assert distances(seen(before))[1] == pytest.approx(30.0 - HALF_M, abs=0.6)
    assert distances(seen(lit_crossing().with_ego(x=0.0)))[1] == 0.0


@pytest.mark.parametrize(
    ("state", "column"), [(LightState.RED, 1), (LightState.YELLOW, 2), (LightState.GREEN, 3), (LightState.OFF, None)]
)
def test_the_light_of_the_route_is_told(state: LightState, column: int | None) -> None:
    scene = lit_crossing().with_ego(x=-60.0).with_lights(LightState.GREEN, s=state)
    row = junctions(seen(scene))[0]
    assert np.flatnonzero(row[1:4]).tolist() == ([] if column is None else [column - 1])
    assert 0.0 < row[0] < 1.0


def test_a_stop_sign_is_told_and_no_junction_is_far() -> None:
    first, second = junctions(seen(stop_sign_crossing().with_ego(x=-60.0)))
    assert first[1:].tolist() == [0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    assert second.tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(("speed", "expected"), [(0.0, 0.0), (6.0, 0.25), (12.0, 1.0), (20.0, 1.0)])
def test_whether_the_ego_can_still_stop_is_told(speed: float, expected: float) -> None:
    observation = seen(lit_crossing().with_ego(x=-60.0, speed=speed))
    observation["junctions_ahead"][0, 0] = 9.0
    assert junctions(observation)[0, 6] == pytest.approx(expected)


def test_strips_by_hand() -> None:
    """In the lane: a car 25 m ahead with 3 m/s; in the left lane one beside and one 30 m behind with 12 m/s."""
    scene = ego().with_actor(x=125.0, speed=3.0)
    scene = scene.with_actor(x=101.0, speed=8.0, left=3.2).with_actor(x=70.0, speed=12.0, left=3.2)
    own, left, right = strips(seen(scene))
    assert own == pytest.approx([1.0, math.sqrt((25.0 - 2 * HALF_M) / 50.0), 0.2, 1.0, 0.0], abs=1e-3)
    assert left == pytest.approx([1.0, 0.0, 8.0 / 15.0, 0.0, 8.0 / 15.0], abs=1e-3)
    assert right == pytest.approx([0.0, 1.0, 0.0, 1.0, 0.0], abs=1e-3)


def test_the_oncoming_lane_is_no_lane_to_change_to() -> None:
    lane = straight_road().mission.start.model_copy(update={"lane": "w_e_1"})
    goal = straight_road().mission.goal.model_copy(update={"lane": "w_e_1"})
    import dataclasses

    scene = dataclasses.replace(
        straight_road(), mission=straight_road().mission.model_copy(update={"start": lane, "goal": goal})
    )
    _, left, right = strips(seen(scene.with_ego(x=100.0).with_actor(x=130.0, speed=9.0, left=3.2, heading=math.pi)))
    assert (left[0], right[0]) == (0.0, 1.0)
    assert left[2] == pytest.approx(-9.0 / 15.0), "it comes towards the ego"


def test_a_root_keeps_sign_and_order_and_tells_half_metres_apart() -> None:
    there = np.array([-80.0, -50.0, -2.0, 0.0, 0.5, 2.0, 18.0, 50.0, 1000.0]) / 50.0
    assert root(there) == pytest.approx([-1.0, -1.0, -0.2, 0.0, 0.1, 0.2, 0.6, 1.0, 1.0])


def test_crossings_by_hand() -> None:
    """A car and somebody on foot who come, one who has left, and a car that joins 100 m ahead at 10 m/s."""
    conflicts = np.full((16, 8), 1000.0, dtype=np.float32)
    conflicts[:, 6:] = -1
    conflicts[0] = (-5.0, -1.0, 2.0, 9.0, 8.0, 1.0, 0, 4)  # the ego has left
    conflicts[1] = (4.0, 9.0, -3.0, -0.5, 8.0, 1.0, 0, 5)  # the other has
    conflicts[2] = (8.0, 18.0, 20.0, 28.0, 5.0, 1.0, 0, 6)
    conflicts[3] = (18.0, 24.5, 3.0, 5.0, 0.0, -1.0, int(ActorKind.PEDESTRIAN), 7)
    conflicts[4] = (32.0, 1000.0, 40.0, 1000.0, 10.0, 0.0, 0, 8)
    got = crossings(conflicts)
    assert got[0] == pytest.approx([1, 0.4, 0.6, math.sqrt(0.4), 0.5, 0.7, 1 / 3, 1.0, 0.0], abs=1e-6)
    assert got[1] == pytest.approx([1, 0.6, 0.7, math.sqrt(0.06), 0.75, 1.0, 0.0, -1.0, 1.0], abs=1e-6)
    assert got[2] == pytest.approx([1, 0.8, 1.0, math.sqrt(0.8), 0.5, 1.0, 2 / 3, 0.0, 0.0], abs=1e-6)
    assert not got[3:].any()


def test_who_crosses_at_a_junction_is_told() -> None:
    scene = lit_crossing().with_ego(x=-40.0, speed=8.0)
    assert not crossings(seen(scene)["conflicts"]).any()
    walker = (
        straight_road().with_ego(x=100.0, speed=8.0).with_pedestrian(x=120.0, y=-4.8, heading=math.pi / 2, speed=1.5)
    )
    assert crossings(seen(walker)["conflicts"])[0, (0, 8)].tolist() == [1.0, 1.0]


def test_actors_by_hand() -> None:
    scene = ego().with_actor(x=110.0, speed=6.0, heading=math.pi / 2, left=3.0).with_pedestrian(x=104.0, y=-4.8)
    near = actors_near(seen(scene))
    walker, car = math.sqrt((4.0 - HALF_M - 0.15) / 50.0), math.sqrt((10.0 - HALF_M - 0.9) / 50.0)
    assert near[0] == pytest.approx([1, walker, -0.25 / 8, 0.25 / 8, 1, 0, 0, 0.03, 1], abs=2e-3)
    assert near[1] == pytest.approx([1, car, 0.75 / 8, 5.25 / 8, 0, 1, 0.4, 0.45, 0], abs=2e-3)
    assert not near[2:].any()


@given(
    st.lists(
        st.tuples(st.floats(-60, 60), st.floats(-10, 10), st.floats(-3, 3), st.floats(0, 20)), min_size=0, max_size=12
    ),
    st.floats(-2, 2),
)
def test_everything_is_of_about_unit_scale(actors: list[tuple[float, float, float, float]], left: float) -> None:
    scene = ego(200.0, left=left)
    for dx, side, heading, speed in actors:
        scene = scene.with_actor(x=200.0 + dx, left=side, heading=heading, speed=speed, kind=ActorKind.CAR)
    observation = seen(scene)
    for array in (strips(observation), actors_near(observation), junctions(observation)):
        assert np.isfinite(array).all()
        assert np.abs(array).max() <= 2.0
    impact, event = distances(observation)
    assert 0.0 <= impact <= 50.0
    assert 0.0 <= event <= 50.0
