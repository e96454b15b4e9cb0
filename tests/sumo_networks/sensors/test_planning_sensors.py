from __future__ import annotations

import numpy as np
import pytest

from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.sensors.lanes import ATTRIBUTES, POINTS
from dohyo.sumo_networks.world import LightState, World
from tests.worlds import lit_crossing, straight_road


def read(sensor: str, world: World) -> np.ndarray:
    (made,) = make_sensors([sensor])
    array = made.read(world, 0)
    assert array.dtype == np.float32
    assert made.space.contains(array)
    return array


def test_lanes_are_pieces_in_driving_direction() -> None:
    rows = read("lanes", straight_road().with_ego(x=500.0).world())
    rows = rows[rows[:, 0] >= 0]
    points = rows[:, ATTRIBUTES:].reshape(-1, POINTS, 2)
    first = points[0]
    # 1 km in 25 pieces of 40 m; the ego is in the right lane, 3.2 m wide, with 13.89 m/s.
    assert rows[0, 2:7] == pytest.approx([0.0, 3.2, 13.89, 2.0, -1.0], abs=1e-3)
    np.testing.assert_allclose(first[:, 1], 0.0, atol=1e-3)
    assert first[-1, 0] - first[0, 0] == pytest.approx(40.0, abs=0.1)
    assert sorted({round(float(y), 1) for y in points[:, 0, 1]}) == [0.0, 3.2, 6.4, 9.6]
    heads_west = points[:, -1, 0] < points[:, 0, 0]
    assert (points[heads_west][:, 0, 1] > 5.0).all()
    assert rows[np.isclose(points[:, 0, 1], 3.2, atol=0.1), 5].tolist()[0] == 1.0


def test_lanes_inside_a_junction_show_the_light_that_guards_them() -> None:
    scene = lit_crossing().with_ego(x=-30.0).with_lights(LightState.RED, s=LightState.GREEN)
    rows = read("lanes", scene.world())
    inside = rows[(rows[:, 0] >= 0) & (rows[:, 2] == 1)]
    assert set(inside[:, 6].tolist()) == {float(LightState.RED), float(LightState.GREEN)}
    assert (rows[(rows[:, 0] >= 0) & (rows[:, 2] == 0), 6] == -1.0).all()


def test_the_path_reaches_behind_and_ahead() -> None:
    rows = read("path", straight_road().with_ego(x=100.0, left=0.5).world())
    assert rows[12, :2] == pytest.approx([0.0, -0.5], abs=0.51)
    np.testing.assert_allclose(np.diff(rows[:, 0]), 1.0, atol=2e-3)
    assert rows[0, 4:] == pytest.approx([13.89, 3.2], abs=1e-3)
    beginning = read("path", straight_road().with_ego(x=3.0).world())
    assert (beginning[:8, 0] == beginning[0, 0]).all()


def test_the_egos_state_is_told_from_the_routes_start() -> None:
    scene = straight_road().with_ego(x=100.0, left=0.5, heading=0.2, speed=7.0)
    start = scene.route.position[0]
    row = read("ego_state", scene.world())
    assert row == pytest.approx([100.0 - start[0], 0.5, 0.2, 7.0, 0.0, 0.0, 0.0, 4.5, 1.8], abs=1e-4)
