from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test

from dohyo.agents.speed_planning.env import FORECASTER, PLANNER, DissipationEnv, last_reports
from dohyo.agents.speed_planning.study.dissipation import Morning
from dohyo.sumo_networks.errors import InvalidInputError

EARLY = Morning(start_s=5.3 * 3600, duration_s=70, warm_up_s=60, penetration=0.3)
"""Before the peak, so that a test has little traffic."""


@pytest.fixture
def env() -> Iterator[DissipationEnv]:
    env = DissipationEnv(EARLY, seed=1)
    yield env
    env.close()


@pytest.mark.slow
def test_it_is_a_pettingzoo_environment() -> None:
    env = DissipationEnv(replace(EARLY, duration_s=3.0, warm_up_s=20.0), seed=1)
    parallel_api_test(env, num_cycles=10)
    assert len(env.possible_agents) > 2
    env.close()


@pytest.mark.slow
def test_a_slow_plan_slows_the_vehicles_that_keep_to_it(env: DissipationEnv) -> None:
    seen, _ = env.reset()
    vehicles = [agent for agent in env.agents if agent not in (FORECASTER, PLANNER)]
    assert vehicles
    assert all(env.observation_space(agent).contains(one) for agent, one in seen.items())
    target = np.full(env.action_space(PLANNER).shape, 12.0, dtype=np.float32)
    steps = 0
    while env.agents:
        actions = {agent: seen[agent][3:4] for agent in env.agents if agent not in (FORECASTER, PLANNER)}
        seen, reward, ended, over, _ = env.step({**actions, PLANNER: target, FORECASTER: np.full(21, 30, np.float32)})
        steps += 1
    assert steps == 140
    there = [agent for agent in vehicles if agent in seen and not ended[agent]]
    assert np.mean([seen[agent][0] for agent in there]) < 15.0
    assert len({*reward.values()}) == 1
    assert all(over.values())


def test_a_segment_without_a_report_has_the_speed_of_free_traffic() -> None:
    assert last_reports(np.array([[20.0, -1.0, 10.0], [-1.0, -1.0, 12.0]])).tolist() == [20.0, 45.0, 12.0]


@pytest.mark.slow
def test_the_planner_sees_the_last_reports_and_then_the_forecasts_of_a_step_before() -> None:
    """As the service shows them; an answer between two publications counts, too."""
    env = DissipationEnv(replace(EARLY, duration_s=4.0, warm_up_s=330.0), seed=1)
    seen, _ = env.reset()
    reports = last_reports(seen[FORECASTER].astype(np.float64))
    assert reports.min() < 40.0
    assert np.array_equal(seen[PLANNER], env.state_of(reports).astype(np.float32))
    for speed in (20, 30):
        seen, *_ = env.step({FORECASTER: np.full(21, speed, np.float32)})
        assert np.array_equal(seen[PLANNER], env.state_of(np.full(21, float(speed))).astype(np.float32))
    env.close()


@pytest.mark.parametrize("seed", [True, 1.5, "a", -1, 2**31, 2**70])
def test_a_wrong_seed_is_refused_before_anything_changes(seed: object) -> None:
    env = DissipationEnv(EARLY, seed=1)
    there = env.possible_agents
    with pytest.raises(InvalidInputError, match="expected a seed, a whole number from 0 to"):
        env.reset(seed=seed)  # type: ignore[arg-type]  # what a caller may give
    assert env.possible_agents is there


@pytest.mark.slow
def test_bad_actions_and_steps_without_reset_are_refused(env: DissipationEnv) -> None:
    with pytest.raises(InvalidInputError, match="reset before step"):
        env.step({})
    env.reset()
    with pytest.raises(InvalidInputError, match="action of 'planner'"):
        env.step({PLANNER: np.zeros(3, dtype=np.float32)})
    with pytest.raises(InvalidInputError, match=r"action of 'planner', speeds in m/s: expected an array .* got 'abc'"):
        env.step({PLANNER: "abc"})  # type: ignore[dict-item]  # what a caller may give
    with pytest.raises(InvalidInputError, match="expected real numbers"):
        env.step({FORECASTER: np.full(21, 20.0 + 1j)})  # type: ignore[dict-item]
    with pytest.raises(InvalidInputError, match="finite"):
        env.step({FORECASTER: np.full(21, np.nan, dtype=np.float32)})
