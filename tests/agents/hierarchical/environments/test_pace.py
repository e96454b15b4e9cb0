"""The pace of a careful driver, on hand-made worlds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.hierarchical.environments.pace import Pace, Restraint, following_speed, pace_of, stopping_speed
from dohyo.agents.planning.surroundings import Surroundings
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import ActorKind, LightState
from tests.worlds import Scene, lit_crossing, straight_road

ALL = frozenset(Restraint)
SENSORS = ("route", "path", "junctions_ahead", "conflicts", "objects", "lanes", "navigation", "speedometer")
LIMIT = 13.89
HALF = 2.25


def pace(scene: Scene, restraints: frozenset[Restraint] = ALL) -> Pace:
    world = scene.world()
    seen = {sensor.name: sensor.read(world, 0) for sensor in make_sensors(SENSORS)}
    return pace_of(seen, Surroundings(seen), restraints)


def test_a_free_road_is_driven_at_its_limit():
    found = pace(straight_road().with_ego(x=100.0, speed=10.0))
    assert found.target == pytest.approx(LIMIT, abs=0.01)
    assert found.least == pytest.approx(0.8 * LIMIT, abs=0.01)
    assert found.most == pytest.approx(1.2 * LIMIT, abs=0.01)
    assert not found.held


@pytest.mark.parametrize("light", [LightState.RED, LightState.YELLOW])
def test_before_a_closed_light_the_ego_stands(light):
    crossing = lit_crossing()
    line = crossing.stop_line("w_c_0")
    scene = crossing.with_ego(x=line - HALF - 2.5).with_lights(light)
    found = pace(scene)
    assert found.target == 0.0
    assert found.most == pytest.approx(1.2 * LIMIT, abs=0.01)  # braking pays long before the ego stands
    assert found.held
    assert found.stop_m == pytest.approx(2.5, abs=0.3)
    assert pace(scene, frozenset({Restraint.LEADER})).target > 5.0


def test_a_closed_light_far_ahead_holds_nobody_yet():
    crossing = lit_crossing()
    scene = crossing.with_ego(x=crossing.stop_line("w_c_0") - HALF - 22.0, speed=5.0).with_lights(LightState.RED)
    found = pace(scene)
    assert found.target == pytest.approx(math.sqrt(2 * 2.0 * 20.0), abs=0.2)
    assert not found.held


def test_a_green_light_and_one_that_is_behind_hold_nobody():
    crossing = lit_crossing()
    line = crossing.stop_line("w_c_0")
    green = crossing.with_ego(x=line - HALF - 3.0).with_lights(LightState.GREEN)
    past = crossing.with_ego(x=line - HALF + 1.0).with_lights(LightState.RED)
    assert pace(green).target > 5.0
    assert pace(past).target > 5.0


def test_behind_somebody_who_stands_the_ego_stands():
    found = pace(straight_road().with_ego(x=100.0).with_actor(x=100.0 + 2 * HALF + 3.0))
    assert found.target == 0.0
    assert found.held


def test_somebody_in_the_lane_beside_is_no_leader():
    found = pace(straight_road().with_ego(x=100.0, speed=10.0).with_actor(x=110.0, left=3.2))
    assert found.target == pytest.approx(LIMIT, abs=0.01)


def test_somebody_on_foot_who_walks_into_the_way_is_waited_for():
    scene = straight_road().with_ego(x=100.0, speed=5.0)
    scene = scene.with_pedestrian(112.0, 1.5, y=-8.5, heading=math.pi / 2)
    assert pace(scene).target < 5.5
    assert pace(scene, frozenset({Restraint.LEADER})).target > 10.0
    assert scene.world().actors.kind.tolist() == [ActorKind.PEDESTRIAN]


def test_following_closes_a_wide_gap_and_opens_a_narrow_one():
    settled = 2.5 + 1.0 * 8.0
    assert following_speed(settled, 8.0) == pytest.approx(8.0)
    assert following_speed(settled + 5.0, 8.0) > 8.0
    assert following_speed(settled - 5.0, 8.0) < 8.0
    assert following_speed(2.0, -3.0) == 0.0


def test_stopping_ends_at_the_gap_and_never_asks_for_more_than_4_m_s2():
    assert stopping_speed(2.0, gap=2.0) == 0.0
    speeds = np.array([stopping_speed(d, gap=2.0) for d in np.arange(2.0, 60.0, 0.01)])
    braking = np.diff(speeds**2) / (2 * 0.01)
    assert braking.max() < 4.05
