"""Each condition does something, and it can be measured."""

from __future__ import annotations

import numpy as np
import pytest

from dohyo.sumo_networks.conditions import CONDITIONS, TEST, TRAIN, conditions_named
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import UnknownNameError
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import ActorKind
from tests.worlds import LANE_M, Scene, straight_road

MISSION = Mission(start=Place(lane="737320747#3_2", position_m=5.0), goal=Place(lane="737320747#4_2", position_m=60.0))


def drive(conditions: str, seconds: float, action: list[float], vehicles: int = 0) -> DrivingEnv:
    scenario = Scenario(
        network="ingolstadt",
        missions=(MISSION,),
        traffic=Traffic(vehicles=vehicles, warm_up_s=20.0),
        conditions=conditions,
        seed=2,
    )
    env = DrivingEnv(scenario, control="acceleration_steering", reward=None)
    env.reset()
    for _ in range(round(seconds * 10)):
        env.step({"ego": np.array(action)})
    return env


def braking_distance(conditions: str) -> float:
    env = drive(conditions, 3.0, [4.0, 0.0])
    start = env.world.egos.driven[0]
    while env.world.egos.speed[0] > 0:
        env.step({"ego": np.array([-8.0, 0.0])})
    distance = float(env.world.egos.driven[0] - start)
    env.close()
    return distance


def traffic_speed(conditions: str) -> float:
    env = drive(conditions, 0.1, [0.0, 0.0], vehicles=25)
    speeds = []
    for _ in range(300):
        env.step({"ego": np.array([0.0, 0.0])})
        speeds += env.world.actors.speed.tolist()
    env.close()
    return float(np.mean(speeds))


def test_train_and_test_groups_share_nothing() -> None:
    assert (len(TRAIN), len(TEST)) == (4, 2)
    assert not set(TRAIN) & set(TEST)
    assert len({conditions.model_dump_json() for conditions in CONDITIONS.values()}) == 6


def test_a_slippery_road_lengthens_the_braking_distance() -> None:
    clear, wet, heavy = (braking_distance(name) for name in ("clear", "wet", "heavy-rain"))
    assert clear < wet < heavy
    assert heavy == pytest.approx(clear / 0.6, rel=0.2)


def test_others_slow_down_on_a_slippery_road() -> None:
    assert traffic_speed("heavy-rain") < 0.95 * traffic_speed("clear")


def crowd() -> Scene:
    """An ego with others 10, 30, ... 90 m ahead."""
    scene = straight_road().with_ego(x=20, speed=0)
    for ahead in range(10, 100, 20):
        scene = scene.with_actor(x=20 + ahead, speed=10, left=LANE_M)
    return scene


def detections(conditions: str, ticks: int = 2000, seed: int = 0) -> np.ndarray:
    (sensor,) = make_sensors(["detections"], conditions=conditions_named(conditions), rng=np.random.default_rng(seed))
    world = crowd().world()
    return np.array([sensor.read(world, 0) for _ in range(ticks)])


def test_in_clear_conditions_a_detection_is_the_truth() -> None:
    (objects,) = make_sensors(["objects"])
    assert (detections("clear", ticks=1)[0] == objects.read(crowd().world(), 0)).all()


@pytest.mark.parametrize("name", [name for name in CONDITIONS if name != "clear"])
def test_conditions_bound_the_sight_and_blur_and_drop_detections(name: str) -> None:
    conditions = conditions_named(name)
    seen = detections(name)
    found = seen[..., 0] == ActorKind.CAR
    within = sum(np.hypot(ahead, LANE_M) <= conditions.sight_m for ahead in range(10, 100, 20))
    assert found.sum() / (len(seen) * within) == pytest.approx(1 - conditions.dropout, abs=0.02)
    assert seen[..., 1].max() < conditions.sight_m + 5 * conditions.position_noise_m * 5
    nearest = seen[:, 0][np.abs(seen[:, 0, 1] - 10) < 5]
    expected = conditions.position_noise_m * np.hypot(10, LANE_M) / 20
    assert nearest[:, 1].std() == pytest.approx(expected, rel=0.25)
    assert nearest[:, 4].std() == pytest.approx(10 * conditions.speed_noise, rel=0.25)


def test_noise_follows_the_seed() -> None:
    assert (detections("wet", seed=1) == detections("wet", seed=1)).all()
    assert (detections("wet", seed=1) != detections("wet", seed=2)).any()


def test_unknown_conditions_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'wet'"):
        conditions_named("wett")
