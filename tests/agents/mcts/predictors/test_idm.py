"""IDM roll-outs, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.mcts.predictors.idm import MODEL, IdmRollout
from dohyo.agents.planning.motion import idm_acceleration
from dohyo.agents.planning.scene import Scene
from dohyo.sumo_networks.sensors.lanes import CROSSING, JUNCTION
from dohyo.sumo_networks.world import ActorKind
from tests.agents.mcts.predictors.scenes import Body, Lane, scene, straight

ASIDE = 50.0
"""Lanes of these tests are beside the ego, so that it does not meddle."""


def road(*more: Lane, end: float = 200.0) -> list[Lane]:
    return [straight(-20.0, end, y=ASIDE), *more]


def rolled(now: Scene) -> np.ndarray:
    return IdmRollout().predict(now).actors


def test_on_a_free_road_it_follows_idm_step_by_step():
    poses = rolled(scene([Body(0.0, ASIDE, speed=5.0)], road()))[0]
    speed, x = 5.0, 0.0
    for k in range(81):
        assert poses[k] == pytest.approx([x, ASIDE, 0.0], abs=1e-6), k
        drive = MODEL.acceleration * (1 - (speed / 10.0) ** MODEL.exponent)
        faster = speed + drive * 0.1
        x, speed = x + (speed + faster) * 0.05, faster
    assert speed == pytest.approx(10.0, abs=0.3)


def test_behind_a_standing_leader_it_stops_with_its_gap():
    first, second = rolled(scene([Body(40.0, ASIDE, kind=ActorKind.STATIC), Body(0.0, ASIDE, speed=8.0)], road()))
    assert (first[:, 0] == 40.0).all()
    gap = 40.0 - second[80, 0] - 4.0
    assert 1.5 < gap < 4.0
    assert np.diff(second[:, 0]).min() >= 0.0


def test_it_follows_a_moving_leader_at_its_speed():
    leader, follower = rolled(
        scene([Body(25.0, ASIDE, speed=5.0), Body(0.0, ASIDE, speed=10.0)], [straight(-20, 200, ASIDE, limit=5.0)])
    )
    assert leader[80, 0] == pytest.approx(25 + 40, abs=0.1)
    assert (leader[:, 0] - follower[:, 0] > 4.0).all()
    assert (follower[80, 0] - follower[70, 0]) == pytest.approx(5.0, abs=0.6)


def test_the_first_step_behind_a_leader_is_idms():
    poses = rolled(scene([Body(20.0, ASIDE, speed=6.0), Body(0.0, ASIDE, speed=8.0)], road()))[1]
    drive = idm_acceleration(MODEL, 8.0, 10.0, 20.0 - 4.0, 6.0)
    assert poses[1, 0] == pytest.approx(0.8 + 0.5 * drive * 0.01)


def test_nobody_on_another_lane_is_a_leader():
    alone = rolled(scene([Body(0.0, ASIDE, speed=8.0)], road()))[0]
    beside = rolled(
        scene([Body(0.0, ASIDE, speed=8.0), Body(15.0, ASIDE + 3.2)], road(straight(-20, 200, ASIDE + 3.2)))
    )
    assert beside[0] == pytest.approx(alone)


def at_a_light(red: bool) -> list[Lane]:
    before = straight(-20.0, 30.0, y=ASIDE, following=(1,))
    return [
        before,
        straight(30.0, 50.0, y=ASIDE, kind=JUNCTION, red=red, following=(2,)),
        straight(50.0, 200.0, y=ASIDE),
    ]


def test_it_stops_before_a_red_light():
    poses = rolled(scene([Body(0.0, ASIDE, speed=8.0)], at_a_light(red=True)))[0]
    assert 26.0 < poses[80, 0] + 2.0 < 30.0  # its front


def test_who_is_inside_a_junction_in_two_parts_leaves_it_at_red():
    way = [
        straight(-20.0, 30.0, y=ASIDE, following=(1,)),
        straight(30.0, 40.0, y=ASIDE, kind=JUNCTION, red=True, following=(2,)),
        straight(40.0, 50.0, y=ASIDE, kind=JUNCTION, red=True, following=(3,)),
        straight(50.0, 200.0, y=ASIDE),
    ]
    assert rolled(scene([Body(34.0, ASIDE, speed=4.0)], way))[0, 80, 0] > 70.0
    before = rolled(scene([Body(0.0, ASIDE, speed=8.0)], way))[0, 80, 0]
    assert 26.0 < before + 2.0 < 30.0, "who is not yet inside stops at the line"


def test_who_stands_at_red_stays_and_drives_off_at_green():
    body = Body(27.0, ASIDE)
    assert rolled(scene([body], at_a_light(red=True)))[0, 80, 0] == pytest.approx(27.0, abs=0.2)
    assert rolled(scene([body], at_a_light(red=False)))[0, 80, 0] > 60.0


def test_who_cannot_stop_any_more_drives_on():
    assert rolled(scene([Body(25.0, ASIDE, speed=10.0)], at_a_light(red=True)))[0, 80, 0] > 90.0


def test_it_takes_the_straightest_branch_and_the_ego_its_route():
    fork = [
        straight(-20.0, 20.0, following=(1, 2), on_route=2),
        straight(20.0, 60.0),
        Lane(((20.0, 0.0), (25.0, 2.0), (28.0, 8.0), (29.0, 40.0)), on_route=2),
    ]
    forecast = IdmRollout().predict(scene([Body(15.0, 0.0, speed=8.0)], fork, ego_speed=8.0))
    assert forecast.ego is not None
    assert abs(forecast.actors[0, 80, 1]) < 0.1
    assert forecast.ego[80, 1] > 10.0
    assert forecast.ego[80, 2] == pytest.approx(math.pi / 2, abs=0.1)


def test_it_slows_for_a_curve():
    bend = Lane(
        ((0.0, ASIDE), (20.0, ASIDE), (25.0, ASIDE + 2.0), (27.0, ASIDE + 7.0), (27.0, ASIDE + 30.0)), limit=14.0
    )
    poses = rolled(scene([Body(1.0, ASIDE, speed=12.0)], [bend]))[0]
    speed = np.hypot(*np.diff(poses[:, :2], axis=0).T) / 0.1
    corner = np.abs(poses[:-1, 0] - 25.0) < 3.0
    assert speed[corner].min() < 8.0


@pytest.mark.parametrize("kind", [ActorKind.PEDESTRIAN, ActorKind.STATIC])
def test_who_does_not_drive_keeps_its_velocity(kind: ActorKind):
    poses = rolled(scene([Body(0.0, ASIDE, speed=1.5, heading=0.3, kind=kind)], road()))[0]
    assert poses[80] == pytest.approx([12 * math.cos(0.3), ASIDE + 12 * math.sin(0.3), 0.3])


def test_off_the_road_and_without_a_map_it_keeps_its_velocity():
    expected = [0.0 + 40.0, 0.0, 0.0]
    for lanes in ([], [straight(-20, 200, ASIDE)], [straight(-20, 200, 0.0, kind=CROSSING)]):
        assert rolled(scene([Body(0.0, 0.0, speed=5.0)], lanes, ego_speed=0.0))[0, 80] == pytest.approx(expected)


def test_an_offset_from_the_lane_dies_away():
    poses = rolled(scene([Body(0.0, ASIDE + 0.8, speed=8.0)], road()))[0]
    assert poses[0, 1] == pytest.approx(ASIDE + 0.8)
    assert poses[80, 1] == pytest.approx(ASIDE, abs=0.05)
    assert np.abs(np.diff(poses[:, 1])).max() < 0.06


def test_an_empty_scene_is_forecast():
    assert rolled(scene()).shape == (0, 81, 3)


def test_who_has_stood_beside_the_middle_of_its_lane_is_parked():
    parked, waiting = Body(0.0, ASIDE - 1.2), Body(0.0, ASIDE)
    assert np.hypot(*(rolled(scene([parked], road()))[0, :, :2] - (parked.x, parked.y)).T).max() < 1e-6
    assert rolled(scene([waiting], road()))[0, 80, 0] > 20.0
