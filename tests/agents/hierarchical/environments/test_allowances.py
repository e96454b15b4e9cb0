"""What holds the ego back, as the least of each kind, on hand-made worlds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.hierarchical.environments.allowances import ALLOWANCES, allowances
from dohyo.agents.hierarchical.environments.pace import following_speed, stopping_speed
from dohyo.agents.hierarchical.state import nearby
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import ActorKind, LightState
from tests.worlds import Scene, lit_crossing, straight_road

HALF = 2.25
LEADER, LINE, ON_FOOT, FIRST, UNDECIDED = slice(0, 1), slice(1, 3), slice(3, 5), slice(5, 7), slice(7, 9)
FREE = np.ones(ALLOWANCES)


def read(scene: Scene) -> np.ndarray:
    world = scene.world()
    seen = {sensor.name: sensor.read(world, 0) for sensor in make_sensors(nearby.SENSORS)}
    return allowances(nearby.strips(seen), seen["junctions_ahead"], seen["conflicts"])


def rows(*found: tuple[float, float, float, float, ActorKind]) -> np.ndarray:
    """Conflicts: distance to the meeting, the other's, its speed, priority, kind."""
    out = np.full((16, 8), -1.0, dtype=np.float32)
    for row, (enter, other, speed, priority, kind) in zip(out, found, strict=False):
        row[:] = enter, enter + 8.0, other, other + 8.0, speed, priority, kind, 1.0
    return out


def of(conflicts: np.ndarray) -> np.ndarray:
    strips = np.ones((3, 5), dtype=np.float32)
    lights = np.full((4, 4), -1.0, dtype=np.float32)
    return allowances(strips, lights, conflicts)


def test_on_a_free_road_nothing_holds_the_ego_back():
    assert read(straight_road().with_ego(x=100.0, speed=10.0)) == pytest.approx(FREE)


def test_behind_somebody_it_is_the_speed_that_keeps_the_distance():
    found = read(straight_road().with_ego(x=100.0, speed=8.0).with_actor(x=120.0, speed=6.0))
    assert found[LEADER][0] == pytest.approx(following_speed(15.5, 6.0) / 15.0, abs=0.03)
    assert found[1:] == pytest.approx(FREE[1:])


@pytest.mark.parametrize("state", [LightState.RED, LightState.YELLOW])
def test_before_a_closed_light_it_is_the_speed_from_which_it_stands_at_the_line(state):
    crossing = lit_crossing()
    scene = crossing.with_ego(x=crossing.stop_line("w_c_0") - HALF - 20.0).with_lights(state)
    speed, distance = read(scene)[LINE]
    assert speed == pytest.approx(stopping_speed(20.0, 2.0) / 15.0, abs=0.01)
    assert distance == pytest.approx(math.sqrt(20.0 / 50.0), abs=0.01)
    assert read(scene.with_lights(LightState.GREEN))[LINE] == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize(
    ("priority", "kind", "part"),
    [
        (1.0, ActorKind.PEDESTRIAN, ON_FOOT),
        (-1.0, ActorKind.PEDESTRIAN, ON_FOOT),
        (1.0, ActorKind.CAR, FIRST),
        (0.0, ActorKind.CAR, UNDECIDED),
    ],
)
def test_the_nearest_of_each_kind_who_comes_counts_in_whatever_row(priority, kind, part):
    far, near = (30.0, 3.0, 5.0, priority, kind), (12.0, 3.0, 5.0, priority, kind)
    expected = FREE.copy()
    expected[part] = stopping_speed(12.0, 2.0) / 15.0, math.sqrt(12.0 / 50.0)
    assert of(rows(far, near)) == pytest.approx(expected, abs=1e-6)
    assert of(rows(near, far)) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    "row",
    [
        (12.0, 30.0, 5.0, 1.0, ActorKind.CAR),  # comes later than in 4 s
        (12.0, 3.0, 5.0, -1.0, ActorKind.CAR),  # must give way itself
        (-1.0, 3.0, 5.0, 1.0, ActorKind.CAR),  # the ego is there already
        (45.0, 3.0, 5.0, 1.0, ActorKind.CAR),  # too far ahead
    ],
)
def test_who_comes_late_or_gives_way_holds_nobody_back(row):
    assert of(rows(row)) == pytest.approx(FREE)
