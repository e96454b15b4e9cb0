"""Exercises and journeys in SUMO: what is seen, paid, and who is asked."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dohyo.agents.hierarchical.environments.manoeuvre_env import MEASURES, DrivingTaskEnv, ManoeuvreEnv
from dohyo.agents.hierarchical.environments.mission_env import UNDER_RULES, MissionEnv, MissionTask
from dohyo.agents.hierarchical.environments.rewards import INFRACTION
from dohyo.agents.hierarchical.options.actuation import ACTIONS
from dohyo.agents.hierarchical.options.manoeuvres import DRIVE, Manoeuvre, deviation, learned
from dohyo.agents.hierarchical.state.master_observation import CRITICAL, FRESH, OPTIONS
from dohyo.agents.hierarchical.training.tasks import ManoeuvreTask
from dohyo.agents.learning.tasks.task import check_task
from dohyo.agents.planning.surroundings import Surroundings
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM
from tests.agents.hierarchical.untrained import TWIN

ROOT = Path(__file__).parents[4]
STAND = np.array([-1.0, 0.0], np.float32)
RACE = np.array([1.0, 0.0], np.float32)


@contextmanager
def opened(env: DrivingTaskEnv) -> Iterator[DrivingTaskEnv]:
    try:
        yield env
    finally:
        env.close()


def exercise(what: str, **more: Any) -> ManoeuvreEnv:
    return ManoeuvreEnv(ManoeuvreTask(what, TWIN, **more))


def driven(env: DrivingTaskEnv, action: Any, most: int = 400) -> tuple[list[float], bool, bool, dict[str, Any]]:
    rewards = []
    for _ in range(most):
        _, reward, terminated, truncated, info = env.step(action() if callable(action) else action)
        rewards.append(reward)
        if terminated or truncated:
            break
    return rewards, terminated, truncated, info


@pytest.mark.parametrize("what", [*Manoeuvre, DRIVE])
def test_a_task_can_be_trained_on(what):
    task = ManoeuvreTask(what, TWIN)
    check_task(task)
    assert task.observation_space.shape[0] < 200
    assert task.action_space.shape == (ACTIONS,)


def test_an_episode_follows_from_its_seed_and_its_actions():
    def some() -> list[np.ndarray]:
        rng = np.random.default_rng(0)
        with opened(exercise(Manoeuvre.LANE)) as env:
            seen = [env.reset(seed=5)[0]]
            for _ in range(15):
                state, reward, *_ = env.step(rng.uniform(-0.3, 0.3, 2).astype(np.float32))
                seen.append(np.append(state, reward))
        return seen

    one, other = some(), some()
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
    assert len(one[0]) == ManoeuvreTask(Manoeuvre.LANE, TWIN).observation_space.shape[0]


def test_who_races_without_steering_leaves_the_road_and_pays_for_it():
    with opened(exercise(Manoeuvre.LANE)) as env:
        ends = []
        for seed in (1, 2, 3):
            env.reset(seed=seed)
            rewards, terminated, _, info = driven(env, RACE)
            ends.append((rewards[-1], terminated, info["end"], info["infraction"]))
            assert all(0.0 <= reward <= 1.0 for reward in rewards[:-1])
    assert (INFRACTION, True, "infraction", 1.0) in ends


def test_the_sum_pays_in_training_and_the_product_judges_held_out_episodes():
    def first(form: str, seed: int) -> float:
        with opened(exercise(Manoeuvre.LANE, form=form)) as env:
            env.reset(seed=seed)
            return env.step(STAND)[1]

    assert first("sum", 5) > first("product", 5) + 0.1
    assert first("sum", HELD_OUT_FROM) == first("product", HELD_OUT_FROM)


def test_who_stands_on_a_free_road_is_ended_after_5_s_without_reward():
    with opened(exercise(Manoeuvre.LANE)) as env:
        env.reset(seed=next(s for s in range(20) if _stands(s)))
        rewards, terminated, _, info = driven(env, STAND)
    assert (terminated, info["end"], info["success"]) == (True, "standing", False)
    assert len(rewards) == 50
    assert sum(rewards) == pytest.approx(0.0, abs=1e-6)
    assert set(MEASURES) <= info.keys()


def _stands(seed: int) -> bool:
    from dohyo.agents.hierarchical.environments.scenarios import draw_scenario

    scenario = draw_scenario(Manoeuvre.LANE, seed)
    return scenario.missions[0].start_speed_mps is None and not scenario.traffic.vehicles


@pytest.mark.parametrize(("what", "seed"), [(Manoeuvre.LEFT, 3), (Manoeuvre.LIGHTS, 3), (Manoeuvre.BRAKING, 0)])
def test_the_rules_can_do_it(what, seed):
    with opened(exercise(what)) as env:
        env.reset(seed=seed)
        rewards, terminated, truncated, info = driven(env, env.expert_action, 600)
    assert (terminated, truncated, info["success"]) == (False, True, True)
    assert np.mean(rewards) > 0.2


@pytest.mark.parametrize("what", [Manoeuvre.LANE, Manoeuvre.BRAKING])
def test_an_exercise_is_cut_short_where_another_policy_is_to_go_on(what):
    with opened(exercise(what)) as env:
        for seed in range(20):
            env.reset(seed=seed)
            _, terminated, truncated, info = driven(env, env.expert_action, 900)
            if info["end"] == "time" and what not in learned(env.seen, Surroundings(env.seen)):
                assert (terminated, truncated, info["success"]) == (False, True, True)
                return
    raise AssertionError("no exercise of 20 came to what is another's business")


@pytest.mark.parametrize(("what", "lanes"), [(Manoeuvre.LEFT, 1), (Manoeuvre.RIGHT, -1)])
def test_a_change_leads_into_the_lane_beside(what, lanes):
    with opened(exercise(what)) as env:
        env.reset(seed=3)
        index, before = env.driving.world.network.lanes.index, env.driving.world.egos.lane[0]
        assert deviation(env.seen["path"])[0] == pytest.approx(0.0, abs=0.3)
        driven(env, env.expert_action)
        assert index[env.driving.world.egos.lane[0]] - index[before] == lanes
        assert deviation(env.seen["path"])[0] == pytest.approx(0.0, abs=0.4)


def test_a_filter_is_refused_where_egos_start_rolling():
    task = ManoeuvreTask(Manoeuvre.LANE, TWIN.model_copy(update={"localization": "es-ekf"}))
    with pytest.raises(InvalidInputError, match="expected localization 'truth', got 'es-ekf'"):
        ManoeuvreEnv(task)


def test_on_a_journey_the_ego_stands_until_its_filter_runs():
    task = MissionTask(TWIN.model_copy(update={"localization": "es-ekf"}))
    drive = np.array([0.6, 0.0, 0.0], np.float32)
    with opened(MissionEnv(task)) as env:
        env.reset(seed=2)
        speeds = []
        for _ in range(60):
            env.step(drive)
            speeds.append(float(env.driving.world.egos.speed[0]))
        believed = env._outlook.believed["route"]
        assert max(speeds[:25]) == 0.0
        assert speeds[-1] > 2.0
        assert not np.allclose(believed, env.seen["route"], atol=1e-3)


def test_without_a_reset_there_is_one_clear_error():
    with pytest.raises(SimulationError, match="has not been reset"):
        exercise(Manoeuvre.LANE).driving  # noqa: B018 - it raises


@pytest.mark.parametrize("rules", [False, True])
def test_a_journey_tells_what_may_begin_and_takes_an_option_with_each_action(rules):
    task = MissionTask(TWIN, rules_when_critical=rules)
    check_task(task)
    with opened(MissionEnv(task)) as env:
        seen, _ = env.reset(seed=2)
        assert env.observation_space.contains(seen)
        flags = seen[-3:]
        assert (flags[FRESH], flags[CRITICAL]) == (1.0, 0.0)
        available = seen[-3 - len(OPTIONS) : -3]
        assert available[OPTIONS.index(Manoeuvre.LANE)] == 1.0
        # One lane each way: there is nowhere to change to.
        assert available[OPTIONS.index(Manoeuvre.LEFT)] == available[OPTIONS.index(Manoeuvre.RIGHT)] == 0.0
        seen, reward, *_ = env.step(np.array([0.5, 0.0, 0.0], np.float32))
        assert seen[-3:][FRESH] == 0.0
        assert 0.0 <= reward <= 1.0
        _, _, _, info = driven(env, np.array([1.0, 0.0, 3.0], np.float32), 600)
        assert set(task.measures) == {*MEASURES, *UNDER_RULES} <= info.keys()
        assert (info["rules_share"] > 0.0) is rules or info["rules_share"] == 0.0


def test_the_processes_of_environments_do_not_load_torch():
    modules = "dohyo.agents.hierarchical.training.tasks, dohyo.agents.hierarchical.environments.mission_env"
    code = f"import sys, {modules}; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_simulations_want_a_process_of_their_own():
    assert ManoeuvreTask(Manoeuvre.LANE, TWIN).alone
    assert MissionTask(TWIN).alone
