from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from dohyo.agents.speed_planning.acc import MPH, Memory, SetPointPolicy, Settings, settings_of, stock_acc
from dohyo.agents.speed_planning.acc_training import follows_plan, follows_traffic, reward
from dohyo.agents.speed_planning.platoon import HUMANS, PlatoonEnv, idm
from dohyo.agents.speed_planning.ppo import Actor, PpoConfig, train
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError


@pytest.mark.parametrize(
    ("action", "mph"),
    [(-1.0, 20), (0.0, 45), (0.3, 58), (1.0, 80)],  # int((a + 1) 20) m/s: 0, 20, 26, 40
)
def test_speeds_are_whole_mph_the_car_can_be_set_to(action: float, mph: int) -> None:
    assert settings_of(np.array([[action, 0.0]])).speed[0] / MPH == pytest.approx(mph)


def test_gaps_by_thirds() -> None:
    actions = np.array([[0.0, -0.4], [0.0, 0.0], [0.0, 0.4]])
    assert settings_of(actions).gap.tolist() == [0.0, 1.0, 2.0]


def test_34_observations_with_what_they_mean_in_their_place() -> None:
    memory = Memory.of(np.array([20.0]))
    memory.remember(np.array([1.0]), np.array([21.0]), Settings(np.array([24.0]), np.array([2.0])))
    seen = memory.observation(np.array([21.0]), np.array([79.0]), np.array([[10.0, 20, 30, 40]]), np.array([True]))[0]
    assert len(seen) == 34
    assert seen[0] == pytest.approx(21 / 40)
    assert seen[1:6] == pytest.approx([0.25, 0, 0, 0, 0])
    assert seen[6] == 1.0
    assert seen[7:11] == pytest.approx([0.25, 0.5, 0.75, 1.0])
    assert seen[11:14] == pytest.approx([1.0, 24 / 40, 1.0])
    assert seen[14:18] == pytest.approx([21 / 40, 24 / 40, 20 / 40, 20 / 40])


def test_a_leader_beyond_80_m_is_not_seen() -> None:
    memory = Memory.of(np.array([20.0]))
    far = memory.observation(np.array([20.0]), np.array([81.0]), np.zeros((1, 4)), np.array([False]))
    assert far[0, 6] == 0.0


def test_cruise_control_settles_at_its_speed_or_its_gap() -> None:
    speed, gap = 20.0, 60.0
    for _ in range(3000):
        acceleration = stock_acc(speed, gap, 15.0, 30.0, 1.6)
        gap += (15.0 - speed) * 0.1
        speed += acceleration * 0.1
    assert speed == pytest.approx(15.0, abs=0.05)
    assert gap == pytest.approx(3.0 + 1.6 * 15.0, abs=0.5)
    assert stock_acc(30.0, np.inf, 0.0, 30.0, 1.6) == pytest.approx(0.0)


def test_a_human_driver_keeps_speed_alone_and_brakes_when_near() -> None:
    assert idm(33.0, 1e6, 33.0) == pytest.approx(0.0, abs=1e-3)
    assert idm(20.0, 10.0, 10.0) < -4.0


def test_a_platoon_steps_and_its_humans_follow() -> None:
    env = PlatoonEnv(seed=1, roads=4)
    seen = env.reset()
    assert seen.shape == (4, env.observations)
    over, count = False, 0
    while not over:
        seen, gained, over = env.step(follows_traffic(seen))
        count += 1
    assert count == 400
    assert np.isfinite(seen).all()
    assert np.isfinite(gained).all()
    assert (env.least_gap_m > 0).all()
    spacing = -np.diff(env._position, axis=1)
    assert spacing.shape == (4, HUMANS)
    assert (spacing > 5.0).all()


def test_the_same_seed_gives_the_same_leaders() -> None:
    assert (PlatoonEnv(3, 2).reset() == PlatoonEnv(3, 2).reset()).all()
    assert (PlatoonEnv(3, 2).reset() != PlatoonEnv(4, 2).reset()).any()


def test_setting_the_car_to_crawl_costs_reward() -> None:
    def crawls(seen: FloatArray) -> FloatArray:
        return np.tile((-1.0, 1.0), (len(seen), 1))

    assert reward(crawls, seed=5).mean() < reward(follows_plan, seed=5).mean()


class Target:
    """One step of reward -|action - 0.5|; 8 steps per episode."""

    observations, actions = 3, 1

    def reset(self) -> FloatArray:
        self._steps = 0
        return np.ones((16, 3))

    def step(self, action: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
        self._steps += 1
        return np.ones((16, 3)), -np.abs(action[:, 0] - 0.5), self._steps == 8


def test_ppo_learns_a_target_and_its_curve_rises() -> None:
    torch.set_num_threads(1)
    config = PpoConfig(iterations=25, hidden=(8,), learning_rate=1e-2, epochs=5, batch=128)
    actor, curve = train(Target(), config, seed=0)
    assert np.mean(curve[-5:]) > np.mean(curve[:5]) + 0.1
    assert actor.act(np.ones((1, 3)))[0, 0] == pytest.approx(0.5, abs=0.15)


def test_a_policy_comes_back_from_its_file_and_another_file_is_refused(tmp_path: Path) -> None:
    torch.manual_seed(0)
    actor = Actor(34, 2, (8, 8))
    actor.save(tmp_path / "a.safetensors")
    seen = np.random.default_rng(0).normal(size=(5, 34))
    assert Actor.load(tmp_path / "a.safetensors").act(seen) == pytest.approx(actor.act(seen))
    (tmp_path / "b.safetensors").write_bytes(b"no weights at all")
    for name in ("b", "none"):
        with pytest.raises(InvalidInputError, match="expected the weights of a policy"):
            Actor.load(tmp_path / f"{name}.safetensors")


def test_the_shipped_policy_sets_what_the_car_takes() -> None:
    settings = SetPointPolicy.shipped().settings(np.random.default_rng(0).uniform(0, 1, (50, 34)))
    mph = settings.speed / MPH
    assert mph == pytest.approx(np.round(mph))
    assert (mph >= 19.99).all()
    assert (mph <= 80.01).all()
