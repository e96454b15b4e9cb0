"""The worlds in which the speed planner's parts learn: platoons, and mornings of the macroscopic model."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from dohyo.agents.learning.tasks.environments import check_environments
from dohyo.agents.learning.tasks.task import Array, Environments, Task, check_task
from dohyo.agents.speed_planning.study.held_out import follows_plan, follows_traffic, no_buffer
from dohyo.agents.speed_planning.training import buffer_env, platoon
from dohyo.agents.speed_planning.training.buffer_env import BufferEnv
from dohyo.agents.speed_planning.training.buffer_training import BufferTask
from dohyo.agents.speed_planning.training.cruise_control_training import CruiseControlTask
from dohyo.agents.speed_planning.training.platoon import HUMANS, PlatoonEnv

TASKS = (CruiseControlTask(), BufferTask())


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_the_floor_accepts_the_tasks_and_their_environments(task: Task) -> None:
    check_task(task)
    check_environments(task.make_environments(2, processes=False))


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_an_episode_follows_from_its_seed_and_actions_whatever_the_other_rows_do(task: Task) -> None:
    together, alone = task.make_environments(3, processes=False), task.make_environments(1, processes=False)
    together.reset(seed=[1, 2, 3])
    for _ in range(20):
        driven(together, 0.9)
    middle = np.array([False, True, False])
    together.reset(seed=[None, 7, None], options={"reset_mask": middle})
    alone.reset(seed=[7])
    for _ in range(40):
        (of_all, reward_of_all), (own, reward) = driven(together, -0.3), driven(alone, -0.3)
        assert (of_all[middle] == own).all()
        assert reward_of_all[middle] == reward


def driven(environments: Environments, action: float) -> tuple[Array, Array]:
    """Observations and rewards of one step of equal actions."""
    seen, rewards, *_ = environments.step(np.full(environments.action_space.shape or (), action, np.float32))
    return seen["observation"], rewards


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_seeds_differ_and_are_repeatable(task: Task) -> None:
    earned = []
    for seed in (3, 4, 3):
        env = task.make_environments(2, processes=False)
        env.reset(seed=[seed, 9])
        earned.append(driven(env, 0.0)[1])
    assert earned[0][0] != earned[1][0]
    assert (earned[0] == earned[2]).all()


def test_a_platoon_drives_to_its_end_and_its_humans_follow() -> None:
    env = PlatoonEnv(4)
    seen, _ = env.reset(seed=1)
    for _ in range(platoon.DECISIONS):
        seen, rewards, _, truncated, infos = env.step(follows_traffic(named(seen)))
    assert truncated.all()
    assert np.isfinite(seen["observation"]).all()
    assert np.isfinite(rewards).all()
    assert (infos["least_gap_m"] > 0).all()
    assert (infos["unsafe"] <= 1).all()
    spacing = -np.diff(env._position, axis=1)
    assert spacing.shape == (4, HUMANS)
    assert (spacing > platoon.LENGTH_M).all()


def test_setting_the_car_to_crawl_costs_reward() -> None:
    def total(crawls: bool) -> float:
        env = PlatoonEnv(8)
        (seen, _), earned = env.reset(seed=5), 0.0
        for _ in range(100):
            action = np.tile(np.array([-1.0, 1.0], np.float32), (8, 1)) if crawls else follows_plan(named(seen))
            seen, rewards, *_ = env.step(action)
            earned += float(rewards.sum())
        return earned

    assert total(crawls=True) < total(crawls=False)


def test_a_morning_begins_with_traffic_and_pays_what_passes() -> None:
    env = BufferEnv(4)
    seen, _ = env.reset(seed=2)
    assert (seen["observation"][:, :-1].max(axis=1) > 0).all()
    for minute in range(buffer_env.DECISIONS):
        seen, rewards, _, truncated, infos = env.step(no_buffer(named(seen)))
        assert (rewards > 0.3).all()
        assert (rewards <= 1.01).all()
        assert truncated.all() == (minute == buffer_env.DECISIONS - 1)
    assert infos["requested_mps"] == pytest.approx([env.road.diagram.free_speed_mps] * 4)
    assert (infos["discharge"] < 1.0).all()


def test_a_slow_buffer_holds_vehicles_back() -> None:
    env = BufferEnv(2)
    env.reset(seed=[5, 5])
    actions = np.array([[-1.0], [1.0]], np.float32)
    seen = [env.step(actions)[0]["observation"] for _ in range(40)][-1]
    upstream = seen[:, :12].sum(axis=1)
    assert upstream[1] > upstream[0]


def named(seen: dict[str, Array]) -> TensorDict:
    return TensorDict({name: torch.from_numpy(one) for name, one in seen.items()}, [len(seen["observation"])])
