"""The route's path behind the ego, on roads made by hand."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from dohyo.agents.planning.path_behind import FURTHER_M, continued
from dohyo.agents.planning.surroundings import Surroundings
from dohyo.sumo_networks.geometry import wrap_angle
from dohyo.sumo_networks.scenario import Mission, Place
from dohyo.sumo_networks.sensors.path import BEHIND
from tests.agents.driving import made, observed
from tests.worlds import Scene, lit_crossing, straight_road


def left_turn() -> Scene:
    mission = Mission(start=Place(lane="w_c_1"), goal=Place(lane="c_n_1", position_m=-1.0))
    return dataclasses.replace(lit_crossing(), mission=mission)


def at(scene: Scene, row: int) -> Scene:
    """The ego at a point of its route."""
    (x, y), heading = scene.route.position[row], float(scene.route.heading[row])
    return scene.with_ego(x=float(x), y=float(y), heading=heading, speed=5.0)


def after_the_turn(scene: Scene) -> int:
    """Row of the route 8 m behind its bend."""
    return int(np.flatnonzero(np.abs(scene.route.curvature) > 0.01).max()) + 8


@pytest.mark.parametrize("further", [-12, 0, 7, 15])
def test_the_path_goes_on_round_the_bend_by_which_the_ego_came(further: int) -> None:
    scene = left_turn()
    row = after_the_turn(scene) + further
    observation = observed(made("Autopilot"), at(scene, row).world())
    path = continued(observation["path"].astype(np.float64), observation["lanes"])
    behind = scene.route.position[row - BEHIND - FURTHER_M : row + 1] - scene.route.position[row]
    cos, sin = math.cos(scene.route.heading[row]), math.sin(scene.route.heading[row])
    true = np.column_stack([behind @ (cos, sin), behind @ (-sin, cos)])
    assert np.linalg.norm(path[: BEHIND + FURTHER_M + 1, :2] - true, axis=1).max() < 0.3
    heading = scene.route.heading[row - BEHIND - FURTHER_M : row + 1] - scene.route.heading[row]
    assert np.abs(wrap_angle(path[: BEHIND + FURTHER_M + 1, 2] - heading)).max() < 0.35, "of the lane's coarse pieces"
    np.testing.assert_array_equal(path[FURTHER_M:], observation["path"])


def test_who_comes_from_behind_round_a_bend_is_in_his_lane() -> None:
    scene = left_turn()
    row = after_the_turn(scene)
    x, y = scene.route.position[row - 30]
    follower = at(scene, row).with_actor(float(x), 12.0, y=float(y), heading=float(scene.route.heading[row - 30]))
    (seen,) = Surroundings(observed(made("Autopilot"), follower.world())).neighbours
    assert (0.5 * (seen.s_low + seen.s_high), 0.5 * (seen.d_low + seen.d_high)) == pytest.approx((-30.0, 0.0), abs=0.4)
    assert seen.along > 0.99


def test_where_no_lane_leads_it_goes_straight_on() -> None:
    scene = straight_road()
    observation = observed(made("Autopilot"), scene.with_ego(x=float(scene.route.position[5, 0])).world())
    for lanes in (observation["lanes"], np.zeros_like(observation["lanes"])):
        path = continued(observation["path"].astype(np.float64), lanes)
        assert path[:, 0] == pytest.approx(np.arange(-BEHIND - FURTHER_M, len(path) - BEHIND - FURTHER_M), abs=0.05)
        assert np.abs(path[:, 1:3]).max() < 0.01
