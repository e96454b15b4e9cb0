"""GRI's replay: whole demonstrations, their share, their constant reward, and nothing else of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from dohyo.agents.gri.demonstrated_replay import DemonstratedReplay, GriConfig, room_for_demonstrations
from dohyo.agents.gri.experts import DemonstratedTask
from dohyo.agents.learning.experience.behaviour import DEMONSTRATOR, POLICY, PolicyBehaviour
from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.demonstrations import Demonstrations, record_demonstrations
from dohyo.agents.learning.experience.replay import ReplayConfig
from dohyo.agents.learning.tasks.task import Task, named
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.problems import LENGTH, Lock, Point

GAMMA = 0.5
DEMO_REWARD = 7.0


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Demonstrations:
    """Five episodes of the point's expert."""
    return record_demonstrations(
        DemonstratedTask(Point()), tmp_path_factory.mktemp("shown"), 5, expert="its own", seed=9
    )


def explored(
    task: Task, shown: Demonstrations, folder: Path, steps: int, replay_steps: int = 1, **gri: object
) -> DemonstratedReplay:
    """A replay after some steps of two random explorers."""
    torch.manual_seed(0)
    config = GriConfig(**{"demo_reward": DEMO_REWARD, **gri})
    spaces = named(task.observation_space), task.action_space
    stored = ReplayConfig(capacity=50_000, steps=replay_steps)
    replay = DemonstratedReplay(
        folder / "replay", spaces, stored, gamma=GAMMA, slack=10, seed=3, shown=shown, gri=config
    )
    collector = Collector(task.make_environments(2, processes=False), task, seed=0)
    low, high = (torch.from_numpy(bound) for bound in (task.action_space.low, task.action_space.high))  # type: ignore[union-attr]

    def drawn(seen: TensorDict) -> TensorDict:
        return TensorDict({"action": low + (high - low) * torch.rand(2, len(low))}, [2])

    for _ in range(steps):
        replay.add(collector.step(PolicyBehaviour(drawn)))
    return replay


def parts(replay: DemonstratedReplay, count: int = 4000) -> tuple[TensorDict, TensorDict]:
    """Drawn transitions of the demonstrator, and of the explorers."""
    batch = replay.sample(count)
    return batch[batch["source"] == DEMONSTRATOR], batch[batch["source"] == POLICY]


def test_demonstrations_are_a_share_of_the_episodes_and_have_one_reward(shown, tmp_path):
    replay = explored(Point(), shown, tmp_path, steps=100 * LENGTH, p_demo=0.3)
    # 200 explored episodes: 86 demonstrations in the mean, with a deviation of 11.
    episodes = len(replay) / (LENGTH + 1) - 200
    assert episodes == round(episodes), "a demonstration is whole"
    assert 41 <= episodes <= 131
    assert replay.share(DEMONSTRATOR) == pytest.approx(episodes / (episodes + 200))
    demonstrated, own = parts(replay)
    assert len(demonstrated) / 4000 == pytest.approx(replay.share(DEMONSTRATOR), abs=0.04)
    assert (demonstrated["next", "reward"] == DEMO_REWARD).all()
    assert (own["next", "reward"] <= 0.0).all()
    assert len(own["next", "reward"].unique()) > 100


def test_the_same_seed_gives_the_same_demonstrations_and_no_share_gives_none(shown, tmp_path):
    one, other = (explored(Point(), shown, tmp_path / name, 200, p_demo=0.5) for name in "ab")
    assert torch.equal(one.sample(50)["index"], other.sample(50)["index"])
    assert len(one) == len(other) > 200 * 2 + 20
    assert len(explored(Point(), shown, tmp_path / "c", 10 * LENGTH, p_demo=0.0)) == 20 * (LENGTH + 1)


def test_returns_of_several_steps_stay_within_a_demonstration_and_end_where_it_terminates(tmp_path):
    lock = record_demonstrations(DemonstratedTask(Lock()), tmp_path / "lock", 3, expert="its own")
    replay = explored(Lock(), lock, tmp_path, steps=300, replay_steps=3, p_demo=0.4)
    demonstrated, _ = parts(replay)
    sums = {1: DEMO_REWARD, 2: DEMO_REWARD * (1 + GAMMA), 3: DEMO_REWARD * (1 + GAMMA + GAMMA**2)}
    for steps, total in sums.items():
        chosen = demonstrated["next", "steps_to_next_obs"][:, 0] == steps
        assert (demonstrated["next", "reward"][chosen] == total).all()
    # Of six steps the last three see the end, at which the lock is open.
    ended = demonstrated["next", "terminated"][:, 0]
    assert ended.float().mean().item() == pytest.approx(0.5, abs=0.05)
    assert (demonstrated["next", "steps_to_next_obs"][~ended] == 3).all()


def test_demonstrators_that_send_at_a_rate_keep_their_share_of_steps(tmp_path):
    """Episodes of the lock end after a step or two, demonstrations have six: by episodes they would be most of it."""
    lock = record_demonstrations(DemonstratedTask(Lock()), tmp_path / "lock", 3, expert="its own")
    by_steps = explored(Lock(), lock, tmp_path / "steps", 600, p_demo=0.25, unit="steps")
    assert by_steps.share(DEMONSTRATOR) == pytest.approx(0.25, abs=6 / 1200)
    by_episodes = explored(Lock(), lock, tmp_path / "episodes", 600, p_demo=0.25)
    assert by_episodes.share(DEMONSTRATOR) > 0.4


def test_the_controls_demonstrations_only_and_sqil(shown, tmp_path):
    only = explored(Point(), shown, tmp_path / "only", 3 * LENGTH, p_demo=1.0)
    assert only.share(DEMONSTRATOR) == 1.0
    assert len(only) == 6 * (LENGTH + 1), "one for each episode that was explored and not stored"
    demonstrated, own = parts(explored(Point(), shown, tmp_path / "sqil", 12 * LENGTH, p_demo=0.5, explorer_reward=0.0))
    assert (own["next", "reward"] == 0.0).all()
    assert len(demonstrated)


def test_without_a_given_reward_it_is_the_highest_of_the_expert(shown, tmp_path):
    demonstrated, _ = parts(explored(Point(), shown, tmp_path, 20 * LENGTH, p_demo=0.3, demo_reward=None))
    assert set(demonstrated["next", "reward"].flatten().tolist()) == {shown.highest_reward}
    assert shown.highest_reward == 0.0, "the point is at rest at the end"


def test_an_explorers_reward_that_is_not_below_the_demonstrators_is_refused(shown, tmp_path):
    """The highest reward of this task is 0: SQIL without `demo_reward` would learn nothing."""
    with pytest.raises(InvalidInputError, match=r"explorer_reward: expected less than .*got 0; give"):
        explored(Point(), shown, tmp_path, 1, p_demo=0.5, demo_reward=None, explorer_reward=0.0)


def test_a_share_of_demonstrations_is_bad_on_demand(tmp_path):
    def totals(noise: float) -> np.ndarray:
        told = record_demonstrations(
            DemonstratedTask(Point(), noise=noise), tmp_path / f"{noise}", 40, expert="its own"
        )
        return np.array([entry.total for entry in told.index.episodes])

    good = totals(0.0)
    assert (good == good.max()).all()
    bad = totals(0.3) < good.max()
    assert bad.sum() == 12


def test_there_is_room_for_what_a_share_needs(shown):
    by_steps = room_for_demonstrations(GriConfig(p_demo=0.2, unit="steps"), shown, 1000)
    assert by_steps >= 250 * (LENGTH + 1) / LENGTH
    assert room_for_demonstrations(GriConfig(p_demo=0.0), shown, 1000) == 0
    assert room_for_demonstrations(GriConfig(p_demo=0.6), shown, 1000) > 1500 * (LENGTH + 1) / LENGTH
