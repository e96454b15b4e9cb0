from __future__ import annotations

import json
import math
from itertools import pairwise

import numpy as np
import pytest

from dohyo.agents.mcts.config import ACTIONS, MIDDLE
from dohyo.agents.mcts.mbappe import Mbappe
from dohyo.agents.mcts.predictor_only import PredictorOnly
from dohyo.agents.mcts.random_shooting import RandomShooting
from dohyo.agents.planning.prediction import STEPS, Forecast
from dohyo.agents.planning.scene import Scene
from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import Agent, Mission, make_agent
from dohyo.evaluation.settings import SettingsError
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Place
from dohyo.sumo_networks.world import LightState
from tests.agents.driving import drive, fronts, speeds, touched
from tests.agents.mcts.roads import observation
from tests.worlds import lit_crossing, straight_road

WIDTH_M = VehicleParameters().width
MISSION = Mission(start=Place(lane=""), goal=Place(lane=""))


def made(kind: type[Mbappe] = Mbappe, **settings: object) -> Mbappe:
    return kind(**{"predictor": "constant_velocity", "simulations": 128, **settings})


PLANNERS = [
    made,
    lambda: made(RandomShooting),
    lambda: made(steering="wheel"),
    lambda: made(hold_s=0.1, simulations=32),
    lambda: made(simulator="thesis", walks="node", choice="visits", steering="wheel"),
]


def test_on_a_free_road_it_comes_up_to_the_limit_and_stays_in_its_lane() -> None:
    worlds = drive(made(), straight_road().with_ego(x=50.0, speed=0.0), 14.0)
    assert 12.0 < speeds(worlds)[-1] < 14.2
    assert max(abs(float(world.egos.lateral[0])) for world in worlds) < 0.6


class _Waiting(Mbappe):
    """Begins with a plan to stand."""

    def reset(self, mission: Mission, seed: int) -> None:
        super().reset(mission, seed)
        self._plan[:] = (MIDDLE - 1) * ACTIONS + MIDDLE


@pytest.mark.parametrize("drives_off", [True, False])
def test_an_ego_that_stands_does_not_keep_a_plan_to_wait(drives_off: bool) -> None:
    agent = made(_Waiting, drives_off=drives_off, simulations=1)  # which is along its last plan, if it has kept one
    end = speeds(drive(agent, straight_road().with_ego(x=50.0, speed=0.0), 5.0))[-1]
    assert end > 3.0 if drives_off else end == 0.0


def test_an_ego_that_moves_keeps_its_plan_to_stop() -> None:
    agent = made()
    drive(agent, straight_road().with_ego(x=50.0, speed=6.0).with_actor(62.0), 0.5)
    assert agent._plan[0] // ACTIONS < MIDDLE


def test_behind_a_standing_car_it_stands() -> None:
    worlds = drive(made(), straight_road().with_ego(x=50.0, speed=10.0).with_actor(110.0), 14.0)
    assert not touched(worlds)


@pytest.mark.parametrize(("hold_s", "over"), [(0.1, 1), (1.0, 0)])
def test_the_plan_that_is_searched_first_begins_with_what_is_left_of_the_last_one(hold_s: float, over: int) -> None:
    agent = made(hold_s=hold_s, simulations=32)
    agent.act(observation([(30.0, 0.0, 0.0)], speed=9.0))
    why = agent.explain()
    assert why is not None
    left = [int(agent.tree.action[node]) for node in why["plan"][over:]]
    assert agent._plan[: len(left)].tolist() == left
    assert (agent._plan[len(left) :] == -1).all()


class DrivesOn:
    """A predictor that says that the ego keeps its speed of 5 m/s, and nothing of the others."""

    def predict(self, scene: Scene) -> Forecast:
        ego = np.column_stack([0.5 * np.arange(STEPS), np.zeros((STEPS, 2))])
        return Forecast(actors=np.zeros((len(scene.actors.key), STEPS, 3)), ego=ego)


@pytest.mark.parametrize("hold_s", [0.3, 1.2])
def test_a_learned_prior_may_hold_beyond_the_end_of_its_trajectory(hold_s: float) -> None:
    agent = made(steering="wheel", hold_s=hold_s, learned_prior_s=8.0, simulations=16)
    agent.predictor = DrivesOn()
    assert abs(agent.act(observation(speed=5.0))[1]) < 0.2


def test_the_least_variance_gives_priors_far_from_the_actions_allowed() -> None:
    agent = made(prior_variance=0.2, prior="learned", simulations=16)
    agent.predictor = DrivesOn()
    for speed in (5.0, 13.0):
        agent.act(observation([(9.0, 0.0, 0.0)], speed=speed))
    why = agent.explain()
    assert why is not None
    assert all(0.0 <= node["p"] <= 1.0 for node in why["nodes"])


def test_at_a_red_light_it_waits_before_the_line() -> None:
    scene = lit_crossing().with_lights(LightState.RED).with_ego(x=-90.0, speed=9.0)
    worlds = drive(made(), scene, 14.0)
    assert fronts(worlds)[-1] <= scene.stop_line("w_c_0")
    assert speeds(worlds)[-1] < 0.5


def test_a_pedestrian_in_the_way_is_not_run_over() -> None:
    scene = straight_road().with_ego(x=50.0, speed=8.0).with_pedestrian(85.0, 1.2, y=-8.0, heading=math.pi / 2)
    assert not touched(drive(made(), scene, 8.0))


@pytest.mark.parametrize("room", [True, False])
def test_people_are_passed_at_a_distance_that_grows_with_the_speed(room: bool) -> None:
    scene = straight_road().with_ego(x=50.0, speed=12.0).with_pedestrian(110.0, 0.0, y=-6.3)
    worlds = drive(made(room_for_people=room), scene, 9.0)
    beside = [world for world in worlds if abs(float(world.egos.position[0, 0]) - 110.0) < 2.0]
    assert beside, "it does not stand for somebody beside the road"
    spare = [
        abs(float(world.egos.position[0, 1]) + 6.3) - 0.5 * (WIDTH_M + 0.5) - 0.07 * float(world.egos.speed[0])
        for world in beside
    ]
    assert (min(spare) > -0.05) == room


@pytest.mark.parametrize(
    ("keeps_lane", "speed", "stays"), [(True, 10.0, True), (True, 3.0, False), (False, 10.0, False)]
)
@pytest.mark.parametrize("passing", [True, False])
def test_at_speed_it_tries_no_lines_outside_its_lane(
    keeps_lane: bool, speed: float, stays: bool, passing: bool
) -> None:
    planner = made(keeps_lane=keeps_lane, passing=passing)
    for gap in (14.0, 13.0, 12.0, 11.0):
        planner.act(observation([(gap + 4.6, 0.0, 0.0)], speed=speed))
    explained = planner.explain()
    assert explained is not None
    assert (max(abs(node["steering"]) for node in explained["nodes"]) <= 1.0) == stays


class EverybodyStays:
    """A predictor that says that everybody stands still, and nothing of the ego."""

    def predict(self, scene: Scene) -> Forecast:
        now = np.column_stack([scene.actors.position, scene.actors.heading])
        return Forecast(actors=np.repeat(now[:, None], STEPS, axis=1), ego=None)


@pytest.mark.parametrize("caution", [True, False])
def test_to_a_walker_that_is_predicted_to_stand_only_the_cautious_yield(caution: bool) -> None:
    scene = straight_road().with_ego(x=50.0, speed=10.0).with_pedestrian(84.0, 2.0, y=-8.0, heading=math.pi / 2)
    agent = made(caution=caution, keeps_lane=False, room_for_people=False, looks_ahead=False)
    agent.predictor = EverybodyStays()
    assert bool(touched(drive(agent, scene, 6.0))) is not caution


def test_who_looks_ahead_keeps_off_a_walker_that_is_predicted_to_stand() -> None:
    scene = straight_road().with_ego(x=50.0, speed=10.0).with_pedestrian(84.0, 2.0, y=-8.0, heading=math.pi / 2)
    agent = made(caution=False, keeps_lane=False, room_for_people=False, looks_ahead=True)
    agent.predictor = EverybodyStays()
    assert not touched(drive(agent, scene, 6.0))


@pytest.mark.parametrize("planner", PLANNERS)
@pytest.mark.parametrize(
    "start",
    [
        straight_road().with_ego(x=50.0).with_actor(50.0),  # in somebody
        straight_road().with_ego(x=50.0, speed=3.0).with_actor(54.0, left=0.5),
        straight_road().with_ego(x=50.0, y=-25.0),  # off the road
        straight_road().with_ego(x=50.0, y=-400.0, heading=2.0),  # far from everything
        straight_road().with_ego(x=50.0, speed=5.0, heading=math.pi),  # the wrong way
    ],
)
def test_impossible_starts_give_an_action(planner: object, start: object) -> None:
    agent = planner()
    for world in drive(agent, start, 1.0):
        assert np.isfinite(world.egos.position).all()


def test_inside_somebody_it_stays() -> None:
    worlds = drive(made(), straight_road().with_ego(x=50.0).with_actor(50.5), 3.0)
    assert speeds(worlds).max() < 0.5


@pytest.mark.parametrize("planner", PLANNERS)
def test_the_same_seed_gives_the_same_drive(planner: object) -> None:
    scene = straight_road().with_ego(x=50.0, speed=8.0).with_actor(90.0, 3.0)
    a, b = (drive(planner(), scene, 2.0) for _ in range(2))
    np.testing.assert_array_equal(fronts(a), fronts(b))


def test_nothing_of_one_episode_survives_into_the_next() -> None:
    scene, agent = straight_road().with_ego(x=50.0, speed=8.0).with_actor(90.0, 3.0), made()
    first = fronts(drive(agent, scene, 1.5))
    drive(agent, straight_road().with_ego(x=200.0, speed=12.0).with_actor(230.0), 1.5)
    np.testing.assert_array_equal(fronts(drive(agent, scene, 1.5)), first)


def test_what_an_action_does_it_does_in_bounds() -> None:
    agent = made()
    agent.reset(MISSION, 0)
    acceleration, steering = agent.act(observation([(20.0, 0.0, 0.0)], speed=12.0))
    assert -8.0 <= acceleration <= 3.0
    assert -1.0 <= steering <= 1.0


def test_the_explanation_is_a_tree_as_plain_json() -> None:
    agent = made(simulations=64)
    assert agent.explain() is None
    agent.reset(MISSION, 0)
    agent.act(observation([(30.0, 0.0, 4.0)], speed=9.0))
    why = json.loads(json.dumps(agent.explain()))
    known = {0}
    for node in why["nodes"]:
        assert node["parent"] in known
        known.add(node["node"])
        assert len(node["trajectory"]) == 11
        assert set(node) >= {"q", "n", "p", "reward", "acceleration", "steering", "depth", "failed"}
    assert why["root"]["n"] == 64
    top = [node for node in why["nodes"] if node["parent"] == 0]
    assert sum(node["n"] for node in top) == 64
    assert why["plan"][0] in {node["node"] for node in top}


def test_trajectories_of_a_plan_join_up() -> None:
    agent = made()
    agent.reset(MISSION, 0)
    agent.act(observation([(30.0, 0.0, 4.0)], speed=9.0))
    why = agent.explain()
    assert why is not None
    nodes = {node["node"]: node for node in why["nodes"]}
    plan = [nodes[node] for node in why["plan"] if node in nodes]
    for before, after in pairwise(plan):
        assert after["trajectory"][0] == pytest.approx(before["trajectory"][-1], abs=0.02)


def test_a_budget_of_time_ends_the_search() -> None:
    agent = made(simulations=50_000, budget_ms=2.0)
    agent.reset(MISSION, 0)
    agent.act(observation([(30.0, 0.0, 4.0)], speed=9.0))
    why = agent.explain()
    assert why is not None
    assert 0 < why["simulations"] < 50_000


@pytest.mark.parametrize(
    "setting", [{"prior": "both!"}, {"simulations": 0}, {"hold_s": 0.25}, {"prior_variance": 0.1}, {"speed": 3}]
)
def test_settings_that_make_no_sense_are_refused(setting: dict[str, object]) -> None:
    with pytest.raises(SettingsError, match=next(iter(setting))):
        make_agent(resolve("mbappe"), setting)


def test_walks_of_different_depths_are_not_compared_by_their_best() -> None:
    with pytest.raises(InvalidInputError, match="expected choice 'visits' or 'q'"):
        made(walks="node")


def test_an_unknown_predictor_is_refused() -> None:
    with pytest.raises(SettingsError, match="constant_velocity"):
        make_agent(resolve("mbappe"), {"predictor": "constant_velocty"})


def test_random_shooting_begins_the_best_rollout_alone() -> None:
    with pytest.raises(SettingsError, match="best"):
        make_agent(resolve("random-shooting"), {"choice": "visits"})


def test_a_predictor_alone_drives_what_it_predicts() -> None:
    agent: Agent = PredictorOnly(predictor="constant_velocity")
    agent.reset(MISSION, 0)
    action = agent.act(observation(speed=6.0))
    np.testing.assert_allclose(action, np.column_stack([3.0 * np.arange(1, 9), np.zeros(8)]), atol=1e-6)
