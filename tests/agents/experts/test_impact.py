"""The last moment: full braking where it still helps, and only there."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from dohyo.agents.experts.impact import SAFE_ACCELERATION, Impact, impact_speed
from dohyo.agents.planning.turning import Turning
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.sensors import objects
from dohyo.sumo_networks.world import ActorKind
from tests.agents.driving import drive, made, speeds, touched
from tests.worlds import straight_road

HALF = 2.25, 0.9


def straight(points: int = 80) -> Float32Array:
    """A `route` observation that leads straight on."""
    route = np.zeros((points, 7), dtype=np.float32)
    route[:, 0] = np.arange(points)
    return route


def seen(*rows: tuple[float, ...], kind: ActorKind = ActorKind.CAR) -> Float32Array:
    """An `objects` observation of x, y, heading, speed of some cars."""
    out = np.zeros((objects.ROWS, objects.COLUMNS), dtype=np.float32)
    out[:, 0] = -1.0
    for key, (x, y, heading, speed) in enumerate(rows):
        out[key] = kind, x, y, heading, speed, 4.6, 1.8, key
    return out


def box(x: float, y: float, heading: float = 0.0, speed: float = 0.0, rate: float = 0.0) -> FloatArray:
    return np.array([[x, y, heading, speed, rate, 4.6, 1.8]])


def test_the_impact_has_the_speed_that_is_left() -> None:
    path = straight()[:, :3].astype(np.float64)
    assert impact_speed(box(10.0, 0.0), path, 10.0, 0.0, 20, *HALF) == pytest.approx(10.0)
    assert impact_speed(box(10.0, 0.0), path, 10.0, -7.0, 20, *HALF) == pytest.approx(math.sqrt(100 - 14 * 5.45), abs=1)
    assert impact_speed(box(14.0, 0.0), path, 10.0, -7.0, 20, *HALF) == -1.0, "it stands before"


def test_who_turns_is_foreseen_on_his_arc() -> None:
    path = straight()[:, :3].astype(np.float64)
    beside = box(6.0, 3.5, 0.0, 5.0)
    assert impact_speed(beside, path, 5.0, 0.0, 20, *HALF) == -1.0
    assert impact_speed(box(6.0, 3.5, 0.0, 5.0, -0.8), path, 8.0, 0.0, 20, *HALF) > 0.0


@pytest.mark.parametrize(
    ("row", "brakes"),
    [
        pytest.param((9.5, 0.0, 0.0, 0.0), True, id="stands ahead, the last moment"),
        pytest.param((18.0, 0.0, 0.0, 0.0), False, id="stands ahead, time enough"),
        pytest.param((9.5, 3.2, math.pi, 13.0), False, id="comes in his own lane"),
        pytest.param((9.0, -5.0, math.pi / 2, 5.0), True, id="crosses"),
        pytest.param((-8.0, 0.0, 0.0, 16.0), False, id="comes from behind"),
    ],
)
def test_it_brakes_only_when_the_next_moment_would_be_too_late(row: tuple[float, ...], brakes: bool) -> None:
    wish = Impact(*HALF).acceleration(seen(row), straight(), 8.0, 0.0)
    assert wish == (-8.0 if brakes else SAFE_ACCELERATION)


@pytest.mark.parametrize(
    ("row", "stays"),
    [
        pytest.param((4.5, -6.0, math.pi / 2, 5.0), True, id="sweeps across its front"),
        pytest.param((4.5, -6.0, -math.pi / 2, 5.0), False, id="leaves to the right"),
        pytest.param((6.0, 0.0, 0.0, 0.0), False, id="stands ahead, which is for other rules"),
        pytest.param((9.0, 3.2, math.pi, 13.0), False, id="comes in his own lane"),
    ],
)
def test_a_standing_ego_starts_into_nobody_s_way(row: tuple[float, ...], stays: bool) -> None:
    rule = Impact(*HALF)
    assert rule.acceleration(seen(row), straight(), 0.0, 2.0) == (-8.0 if stays else SAFE_ACCELERATION)
    assert rule.acceleration(seen(row), straight(), 0.0, 0.0) == SAFE_ACCELERATION, "it does not want to start"


@pytest.mark.parametrize(("radius", "speed"), [(math.inf, 8.0), (8.0, 4.3), (8.0, 5.0), (-12.0, 6.0)])
def test_who_drives_straight_on_beside_a_turning_ego_turns_not(radius: float, speed: float) -> None:
    # The route is an arc, which the ego follows; another drives straight on. Seen from the ego, it turns.
    bend = 1.0 / radius
    turning, rule = Turning(), Impact(*HALF)
    for tick in range(60):
        s = 10.0 + speed * 0.1 * tick
        route = straight()
        ahead = round(s) + np.arange(80) - s
        route[:, 0], route[:, 2], route[:, 3] = ahead, bend * ahead, bend
        turned = turning.update(route, speed)
        assert turned == pytest.approx(speed * 0.1 * bend if tick else 0.0, abs=1e-4)
        boxes = rule._moving(seen((12.0, 6.0, 0.3 - bend * s, 8.0)), turned)
        assert boxes[0, 4] == pytest.approx(0.0, abs=2e-3)


def test_it_stands_when_somebody_drives_into_its_path_from_the_side() -> None:
    # Nobody on any lane: no other rule expects him.
    scene = straight_road().with_ego(x=100.0, speed=10.0).with_actor(130.0, 6.0, y=-22.0, heading=math.pi / 2)
    worlds = drive(made("Autopilot"), scene, 8.0)
    for before, after in pairwise(worlds):
        assert not (after.contacts and max(before.egos.speed[0], after.egos.speed[0]) > 0.1)
    assert speeds(worlds).min() < 9.0
    assert touched(worlds) == set()
