"""Localized: an agent that sees the filter's pose, and a drive with it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dohyo.agents.localization.localized import STAND, Localized
from dohyo.agents.registry import resolve_with
from dohyo.evaluation.agent import AgentSpec, agent_info, make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.sumo_networks.ego.control import CONTROLS, make_control
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.sensors import make_sensors
from dohyo.sumo_networks.world import World
from tests.worlds import straight_road


class Watcher:
    """Remembers what it saw."""

    spec = AgentSpec(
        name="watcher",
        track="map",
        sensors=("speedometer", "route", "lane", "navigation"),
        control="acceleration_steering",
    )

    def __init__(self) -> None:
        self.seen: list[dict[str, np.ndarray]] = []

    def reset(self, mission: object, seed: int) -> None:
        self.seen.clear()

    def act(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        self.seen.append(observation)
        return np.array([1.0, 0.0])

    def close(self) -> None: ...

    def explain(self) -> None: ...


class Blind(Watcher):
    """Sees nothing of its place."""

    spec = AgentSpec(name="blind", track="sensors", sensors=("speedometer",))


WATCHER = "tests.agents.localization.test_localized:Watcher"


class Fixed:
    """A localizer that believes one pose."""

    filter = None

    def __init__(self, pose: tuple[float, float, float]) -> None:
        self.pose = pose

    def imu(self, time: float, sample: np.ndarray) -> None: ...

    def gnss(self, time: float, position: np.ndarray) -> None: ...


def observed(world: World, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    return {sensor.name: sensor.read(world, 0) for sensor in make_sensors(names)}


def seen_by_the_inner(world: World, pose: tuple[float, float, float]) -> dict[str, np.ndarray]:
    agent = Localized(inner=WATCHER, gnss="gnss_rtk")
    agent.reset(straight_road().mission, 0)
    view = agent._view
    view._tick, view._progress, view.localizer = 1, float(world.egos.progress[0]), Fixed(pose)  # type: ignore[assignment]
    agent.act(observed(world, agent.spec.sensors))
    return agent.inner.seen[0]  # type: ignore[attr-defined,no-any-return]


def test_at_the_true_pose_it_sees_what_everybody_sees() -> None:
    world = straight_road().with_ego(x=430.3, left=0.4, heading=0.1, speed=5.0).world()
    seen = seen_by_the_inner(world, (*world.egos.position[0].tolist(), 0.1))
    true = observed(world, Watcher.spec.sensors)
    assert set(seen) == set(true), "nothing more, such as the raw fixes"
    for name in true:
        np.testing.assert_allclose(seen[name], true[name], atol=2e-2, err_msg=name)
        assert seen[name].dtype == np.float32


def test_it_sees_what_who_stood_at_the_estimate_would_see() -> None:
    here = straight_road().with_ego(x=430.0, speed=5.0).world()
    there = straight_road().with_ego(x=433.0, left=-1.2, heading=-0.2, speed=5.0).world()
    seen = seen_by_the_inner(here, (*there.egos.position[0].tolist(), -0.2))
    for name, expected in observed(there, Watcher.spec.sensors).items():
        np.testing.assert_allclose(seen[name], expected, atol=2e-2, err_msg=name)
    assert seen["lane"][1] == pytest.approx(-1.2, abs=1e-3)


def test_near_the_goal_the_route_ends_where_it_ends() -> None:
    world = straight_road().with_ego(x=990.0).world()
    seen = seen_by_the_inner(world, (*world.egos.position[0].tolist(), 0.0))
    np.testing.assert_allclose(seen["route"], observed(world, ("route",))["route"], atol=2e-2)


def test_only_the_sensors_of_the_inner_agent_and_its_own_are_asked_for() -> None:
    spec = Localized(inner=WATCHER).spec
    assert spec.sensors == (*Watcher.spec.sensors, "imu", "gnss", "route_map")
    assert (spec.name, spec.track, spec.control) == ("watcher+es-ekf", "map", "acceleration_steering")
    assert Localized(inner="autopilot", gnss="gnss_rtk").spec.track == "privileged"


def test_the_setting_localization_wraps_and_others_are_handed_on() -> None:
    entry, settings = resolve_with("autopilot", {"localization": "ekf", "max_speed": 9.0})
    agent = make_agent(entry, settings)
    assert agent.spec.name == "autopilot+ekf"
    assert agent.inner.style.max_speed == 9.0  # type: ignore[attr-defined]
    assert resolve_with("autopilot", {"max_speed": 9.0}) == (
        "dohyo.agents.experts.autopilot:Autopilot",
        {"max_speed": 9.0},
    )
    assert resolve_with(entry, settings) == (entry, settings), "a record's agent is made again as it was"


def test_a_record_tells_both_files_apart() -> None:
    plain = make_agent("dohyo.agents.experts.autopilot:Autopilot")
    wrapped = [Localized(inner=name) for name in ("autopilot", "reckless")]
    hashes = {agent_info(agent, "x").source_sha256 for agent in (plain, *wrapped)}
    assert len(hashes) == 3


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"localization": "es-ekv"}, UnknownNameError, "es-ekf"),
        ({"gnss": "galileo"}, UnknownNameError, "receiver"),
        ({"inner": "autopilott"}, UnknownNameError, "autopilot"),
        (
            {"inner": WATCHER.replace("Watcher", "Blind")},
            InvalidInputError,
            "expected one of the sensors lane, navigation, route, got",
        ),
    ],
)
def test_what_cannot_be_localized_is_refused(arguments: dict[str, str], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        Localized(**arguments)  # type: ignore[arg-type]


def test_standing_is_standing_for_every_control() -> None:
    world = straight_road().with_ego(x=100.0).world()
    for name in set(STAND) & set(CONTROLS):
        drive, steering = make_control(name, VehicleParameters(), 0.1).command(STAND[name], world, 0)
        assert drive < 0.05, name
        assert steering == pytest.approx(0.0)


@pytest.mark.slow
def test_the_autopilot_drives_by_a_filters_pose() -> None:
    agent = Localized(inner="autopilot", gnss="gnss_rtk")
    scenario = load_benchmark("quickstart").scenarios([100])[0]
    scenario = scenario.model_copy(
        update={"traffic": scenario.traffic.model_copy(update={"vehicles": 0, "pedestrians": 0, "bicycles": 0})}
    )
    env = DrivingEnv(scenario, agent.spec.sensors, agent.spec.control, reward=None)
    try:
        observations, _ = env.reset()
        agent.reset(scenario.missions[0], scenario.seed)
        assert agent.explain() == {"localization": "standing still to calibrate"}
        wrong = []
        for tick in range(350):
            action = agent.act(observations["ego"])
            if tick < 25:
                assert action.tolist() == [-3.0, 0.0]
            if agent.localizer.pose is not None:
                east, north, heading = agent.localizer.pose
                x, y = env.world.egos.position[0]
                wrong.append(math.hypot(east - x, north - y))
                assert abs(math.remainder(heading - float(env.world.egos.heading[0]), 2 * math.pi)) < 0.15
            observations = env.step({"ego": action})[0]
            assert abs(env.world.egos.lateral[0]) < 0.5
        assert env.world.egos.driven[0] > 100.0
        assert 1e-4 < max(wrong) < 0.3, "an estimate, and no leak of the truth"
        assert "rule" in (agent.explain() or {})
    finally:
        env.close()
