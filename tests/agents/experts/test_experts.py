from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.experts.reckless import Reckless
from dohyo.sumo_networks.ego.control import CONTROLS, PedalsSteering
from dohyo.sumo_networks.sensors import Track, make_sensors
from dohyo.sumo_networks.world import ActorKind, LightState
from tests.agents.driving import drive, fronts, made, speeds, touched
from tests.worlds import crossing_for_pedestrians, lit_crossing, straight_road

MISSION = straight_road().mission
OBSERVATION = {"speedometer": np.zeros(2, np.float32)}


@pytest.mark.parametrize("name", ["Autopilot", "Reckless", "Random"])
def test_an_expert_asks_only_for_what_its_track_allows(name: str) -> None:
    spec = made(name).spec
    assert len(make_sensors(spec.sensors, Track[spec.track.upper()])) == len(spec.sensors)
    assert spec.control in CONTROLS
    assert spec.name == name.lower()


# Reckless: concern for the lane, none for anybody in it


def test_reckless_keeps_its_lane() -> None:
    worlds = drive(made("Reckless"), straight_road().with_ego(x=50.0, left=0.5), 15.0)
    assert abs(worlds[-1].egos.lateral[0]) < 0.2
    assert fronts(worlds)[-1] > 150.0


def test_reckless_hits_what_stands_in_its_way() -> None:
    scene = straight_road().with_ego(x=50.0).with_actor(100.0, kind=ActorKind.STATIC).with_actor(130.0)
    worlds = drive(made("Reckless"), scene, 12.0)
    assert touched(worlds) == {0, 1}
    assert (np.diff(speeds(worlds)) >= 0).all(), "it never brakes"


def test_reckless_runs_red_lights_and_people_over() -> None:
    scene = crossing_for_pedestrians().with_lights(LightState.RED).with_ego(x=-60.0, speed=10.0)
    worlds = drive(made("Reckless"), scene.with_pedestrian(-8.4, y=-4.8), 6.0)
    assert fronts(worlds)[-1] > lit_crossing().stop_line("w_c_0") + 10.0
    assert touched(worlds) == {0}


def test_reckless_takes_its_throttle_as_a_setting() -> None:
    slow, fast = (
        speeds(drive(Reckless(throttle), straight_road().with_ego(x=50.0), 4.0))[-1] for throttle in (0.2, 1.0)
    )
    assert slow < 0.5 * fast


# Random: the floor of every table


def actions(seed: int, count: int = 100) -> np.ndarray:
    agent = made("Random")
    agent.reset(MISSION, seed)
    return np.array([agent.act(OBSERVATION) for _ in range(count)])


def test_random_is_the_same_for_the_same_seed_only() -> None:
    np.testing.assert_array_equal(actions(3), actions(3))
    assert (actions(3) != actions(4)).any()
    agent = made("Random")
    for _ in range(2):  # a second episode of the same agent too
        agent.reset(MISSION, 3)
        np.testing.assert_array_equal([agent.act(OBSERVATION) for _ in range(100)], actions(3))


def test_random_keeps_an_action_for_a_second() -> None:
    drawn = actions(5).reshape(10, 10, 3)
    np.testing.assert_array_equal(drawn, drawn[:, :1].repeat(10, axis=1))
    assert len(np.unique(drawn[:, 0], axis=0)) == 10


def test_random_draws_from_the_whole_action_space() -> None:
    drawn = actions(6, 10_000)
    assert (drawn >= PedalsSteering.space.low).all()
    assert (drawn <= PedalsSteering.space.high).all()
    np.testing.assert_allclose(drawn.mean(axis=0), [0.5, 0.5, 0.0], atol=0.1)
    assert drawn[:, 2].min() < -0.9
    assert math.isclose(drawn[:, 2].max(), 1.0, abs_tol=0.1)
