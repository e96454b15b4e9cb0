"""Endless driving: episodes that follow from their seeds, their endings, the experts, and the agent that drives so."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from dohyo.agents.endless_driving.config import ExpertConfig, TownConfig
from dohyo.agents.endless_driving.environment import EndlessDrivingEnv
from dohyo.agents.endless_driving.experts import AgentExpert, NoisyExpert, RuleExpert, check_expert
from dohyo.agents.endless_driving.scenarios import TOWN, draw_scenario
from dohyo.agents.endless_driving.task import EndlessDriving
from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.rlad.agent import Rlad
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.sumo_networks.conditions import TRAIN
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.routes.routing import plan_route
from dohyo.sumo_networks.seeds import HELD_OUT_FROM
from tests.agents.endless_driving.policies import drawn_policy

STAND = np.array([-1.0, 0.0], np.float32)


@pytest.fixture
def opened() -> Iterator[list[EndlessDrivingEnv]]:
    """Environments to close: a process holds one simulation."""
    made: list[EndlessDrivingEnv] = []
    yield made
    for env in made:
        env.close()


def environment(
    opened: list[EndlessDrivingEnv], expert: ExpertConfig | None = None, **town: object
) -> EndlessDrivingEnv:
    for one in opened:
        one.close()
    settings = TownConfig.model_validate({"roads": "one-route", "view": "state", **town})
    opened.append(EndlessDrivingEnv(EndlessDriving(settings, expert)))
    return opened[-1]


def driven(env: EndlessDrivingEnv, seed: int) -> dict[str, float]:
    """Measures of an episode that the expert drives."""
    env.reset(seed=seed)
    while True:
        action = env.expert_action()
        assert action is not None
        *_, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            return info


@pytest.mark.parametrize("seed", range(4))
def test_training_stays_in_its_town_and_goals_follow_each_other_for_the_whole_time(seed: int) -> None:
    endless, mission = (draw_scenario("traffic", seed, endless=which) for which in (True, False))
    assert {endless.network, mission.network} == {TOWN}
    assert {endless.conditions, mission.conditions} <= TRAIN.keys()
    length = plan_route(load_network(TOWN), endless.missions[0]).length
    assert length > (endless.time_limit_s or 0.0) * TownConfig().max_speed
    assert len(endless.missions[0].via) > 0 == len(mission.missions[0].via)
    assert endless == draw_scenario("traffic", seed, endless=True) != draw_scenario("traffic", seed + 9, endless=True)


@pytest.mark.parametrize(
    ("expert", "said"),
    [("nobody", "no agent named 'nobody'"), ("parking", "drive cars")],
)
def test_an_expert_that_cannot_be_made_is_refused_before_a_run_begins(expert: str, said: str) -> None:
    with pytest.raises(InvalidInputError, match=said):
        check_expert(expert)
    check_expert("rules")


def test_who_stands_on_a_free_road_is_blocked_after_20_s(opened: list[EndlessDrivingEnv]) -> None:
    env = environment(opened)
    env.reset(seed=1)
    terminated, decisions = False, 0
    while not terminated:
        _, reward, terminated, _, info = env.step(STAND)
        decisions += 1
    assert decisions == 100
    assert info["blocked"] == 1.0
    assert info["distance_m"] == pytest.approx(0.0, abs=0.1)
    assert reward < -0.5


@pytest.mark.parametrize("lawful", [True, False])
def test_only_where_lights_count_a_red_one_that_is_run_ends_the_episode(
    opened: list[EndlessDrivingEnv], lawful: bool
) -> None:
    env = environment(opened, ExpertConfig(), obey_lights=False)
    env.reset(seed=HELD_OUT_FROM)
    env._reward.obey_lights = lawful  # the expert drives on in both
    ended = False
    while not ended:
        action = env.expert_action()
        assert action is not None
        *_, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
    assert info["red_lights"] >= 1.0
    assert terminated == lawful
    assert bool(info["success"]) == (not lawful)


@pytest.mark.parametrize(("stand_below", "driven_m"), [(0.0, (3.0, 6.0)), (0.4, (0.0, 0.0))])
def test_a_target_speed_that_is_nearly_0_creeps_or_stands_as_the_town_says(
    opened: list[EndlessDrivingEnv], stand_below: float, driven_m: tuple[float, float]
) -> None:
    """A policy's squashed mean of -0.9 asks for 0.3 m/s."""
    env = environment(opened, stand_below=stand_below)
    env.reset(seed=0)
    for _ in range(75):
        env.step(np.array([-0.9, 0.0], np.float32))
    low, high = driven_m
    assert low <= float(env.driving.world.egos.driven[0]) <= high


def test_the_rules_reach_the_goal_and_stop_at_lights(opened: list[EndlessDrivingEnv]) -> None:
    info = driven(environment(opened, ExpertConfig()), HELD_OUT_FROM)
    assert info["success"]
    assert info["red_lights"] == 0.0
    assert info["lateral_m"] < 0.3


def test_an_agent_can_be_the_expert_and_noise_makes_it_another(opened: list[EndlessDrivingEnv]) -> None:
    env = environment(opened)
    env.reset(seed=HELD_OUT_FROM)
    scenario, world = env.driving.scenario, env.driving.world
    autopilot = AgentExpert("autopilot")
    autopilot.reset(scenario)
    env.close()
    env._sensors = (*env._sensors, *(name for name in autopilot.sensors if name not in env._sensors))
    env.reset(seed=HELD_OUT_FROM)
    speed, steering = autopilot.advise(env.driving.world, env._observation)
    assert 0.3 < speed < 6.0  # from a standstill it accelerates
    assert abs(steering) < 0.3
    noisy = NoisyExpert(RuleExpert(6.0, obey_lights=False), 0.5, 6.0)
    noisy.reset(scenario)
    speeds = [noisy.advise(world, env._observation)[0] for _ in range(200)]
    random = [speed for speed in speeds if speed != 6.0]
    assert 60 <= len(random) <= 140
    assert len(set(random)) == len(random) / NoisyExpert.HELD_TICKS


def test_the_agent_sees_and_does_what_the_training_does(tmp_path: Path, opened: list[EndlessDrivingEnv]) -> None:
    """Frames, measurements and repeated actions: one policy, driven by both, ends at the same place."""
    task = EndlessDriving(TownConfig(roads="one-route"))
    policy = drawn_policy(tmp_path, task.town)
    onnx = OnnxPolicy(policy)
    stepped = task.make_environments(1, processes=False)
    with torch.no_grad():
        seen, _ = stepped.reset(seed=[HELD_OUT_FROM], options={})
        actions, infos, over = [], {}, False
        while not over:
            actions.append(onnx.of_batch({name: seen[name] for name in onnx.inputs}))
            seen, _, terminated, truncated, infos = stepped.step(actions[-1])
            over = bool(terminated[0] or truncated[0])
    stepped.close()
    agent = Rlad(policy)
    record, trajectory = drive_episode(draw_scenario("one-route", HELD_OUT_FROM, endless=False), {"ego": agent})
    ticks = int(trajectory.tick[trajectory.key == -1].max())
    assert ticks >= 2 * len(actions) - 2
    own = trajectory.progress[trajectory.key == -1]
    assert own[min(2 * len(actions), len(own)) - 1] == pytest.approx(
        float(infos["completion"][0]) / 100.0 * record.egos[0].route_length_m, abs=1.2
    )
    assert np.ptp(np.array(actions)[:, 0, 0]) > 1e-3
