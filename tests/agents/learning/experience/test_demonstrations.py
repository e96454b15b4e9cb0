"""Demonstrations: whole episodes of the expert, complete or refused, as transitions and in a replay."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.spaces import Discrete
from safetensors.numpy import load_file, save_file

from dohyo.agents.learning.experience.behaviour import DEMONSTRATOR
from dohyo.agents.learning.experience.demonstrations import INDEX, Demonstrations, record_demonstrations
from dohyo.agents.learning.experience.replay import Replay, ReplayConfig
from dohyo.agents.learning.files.card import digest
from dohyo.agents.learning.tasks.task import named
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.problems import LENGTH, STEP, Lock, LockEnv, Point


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("demonstrations")
    record_demonstrations(Point(), folder, 5, expert="steps to the middle", seed=3, environments=2)
    return folder


def test_every_transition_is_the_experts_and_leads_to_the_next(recorded):
    with pytest.raises(IndexError):
        Demonstrations(recorded).transitions(range(0))
    rows = Demonstrations(recorded).transitions()
    assert len(rows) == 5 * LENGTH
    place, after = (part["observation", "observation"][:, 0] for part in (rows, rows["next"]))
    assert torch.allclose(rows["action"][:, 0], (-place).clamp(-STEP, STEP))
    assert torch.allclose(after, place + rows["action"][:, 0])
    assert torch.allclose(rows["next", "reward"][:, 0], -after.abs())
    inside = ~rows["next", "done"][:, 0]
    assert torch.equal(after[:-1][inside[:-1]], place[1:][inside[:-1]])
    assert rows["next", "truncated"].sum() == rows["next", "done"].sum() == 5
    assert not rows["next", "terminated"].any()


def test_the_index_tells_what_was_recorded(recorded):
    index = Demonstrations(recorded).index
    assert (index.task, index.expert, index.seed) == ("point", "steps to the middle", 3)
    assert len({episode.seed for episode in index.episodes}) == 5
    assert all(episode.success and episode.length == LENGTH for episode in index.episodes)
    assert all(episode.measures["distance"] < STEP for episode in index.episodes)


def test_recorded_twice_they_are_the_same(recorded, tmp_path):
    again = record_demonstrations(Point(), tmp_path, 5, expert="steps to the middle", seed=3, environments=2)
    assert again.index == Demonstrations(recorded).index


def test_some_episodes_can_be_held_out(recorded):
    learned, held_out = Demonstrations(recorded).split(0.4)
    assert sorted(set(learned["episode"].tolist())) == [0, 1, 2]
    assert sorted(set(held_out["episode"].tolist())) == [3, 4]


def test_a_terminated_episode_keeps_its_end(tmp_path):
    rows = record_demonstrations(Lock(), tmp_path, 2, expert="reads the dials").transitions()
    assert rows["next", "terminated"].sum() == 2
    assert rows["next", "reward"].sum() == 2.0


@pytest.mark.parametrize(("reward", "expected"), [(None, "recorded"), (1.0, "constant")])
def test_a_replay_gets_whole_episodes_with_their_own_or_one_constant_reward(recorded, tmp_path, reward, expected):
    task, demonstrations = Point(), Demonstrations(recorded)
    spaces = (named(task.observation_space), task.action_space)
    replay = Replay(tmp_path / "replay", spaces, ReplayConfig(capacity=100), gamma=0.9, slack=10, seed=0)
    demonstrations.feed(replay, 1, reward)
    batch = replay.sample(64)
    assert (batch["source"] == DEMONSTRATOR).all()
    after = batch["next", "observation", "observation"][:, 0]
    wanted = -after.abs() if expected == "recorded" else torch.ones(64)
    assert torch.allclose(batch["next", "reward"][:, 0], wanted)
    assert torch.allclose(after, batch["observation", "observation"][:, 0] + batch["action"][:, 0])


def test_what_is_incomplete_damaged_or_there_already_is_refused(recorded, tmp_path):
    with pytest.raises(InvalidInputError, match="no demonstrations"):
        Demonstrations(tmp_path)
    with pytest.raises(InvalidInputError, match="holds demonstrations already"):
        record_demonstrations(Point(), recorded, 1, expert="another")
    record_demonstrations(Point(), tmp_path, 1, expert="one")
    path = tmp_path / "episodes" / "000000.safetensors"
    path.write_bytes(path.read_bytes()[:-4] + b"\0\0\0\1")
    with pytest.raises(InvalidInputError, match="another one"):
        Demonstrations(tmp_path).transitions()
    (tmp_path / INDEX).write_text('{"task": "point"}')
    with pytest.raises(InvalidInputError, match="expert"):
        Demonstrations(tmp_path)


def test_an_expert_that_is_silent_gives_no_demonstrations(tmp_path):
    with pytest.raises(InvalidInputError, match="left out"):
        record_demonstrations(Point(reticent=True), tmp_path, 1, expert="silent on the right")
    assert not (tmp_path / INDEX).exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"observation.observation": None}, r"the columns .*, got \['action', 'reward'\]"),
        ({"observation.more": np.zeros((LENGTH + 1, 2), np.float32)}, "got .*'observation.more'"),
        ({"observation.observation": np.zeros((LENGTH, 2), np.float32)}, "'observation.observation'"),
        ({"observation.observation": np.zeros((LENGTH + 1, 3), np.float32)}, "'observation.observation'"),
        ({"observation.observation": np.zeros((LENGTH + 1, 2), np.int64)}, "float32 .*, got int64"),
        ({"observation.observation": np.full((LENGTH + 1, 2), np.nan, np.float32)}, "finite .*'observation.observ"),
        ({"action": np.zeros((LENGTH, 2), np.float32)}, "'action'"),
        ({"action": np.zeros(LENGTH, np.float32)}, "'action'"),
        ({"action": np.zeros((LENGTH - 1, 1), np.float32)}, f"'action' .* of {LENGTH} steps"),
        ({"action": np.full((LENGTH, 1), np.inf, np.float32)}, "finite numbers in column 'action'"),
        ({"action": np.full((LENGTH, 1), 1.01 * STEP, np.float32)}, "'action': expected actions in Box.* in step 0"),
        ({"reward": np.zeros((LENGTH, 1), np.float32)}, "'reward'"),
        ({"reward": np.full(LENGTH, np.nan, np.float32)}, "finite numbers in column 'reward'"),
    ],
)
def test_columns_that_do_not_fit_the_task_are_refused_with_their_file(recorded, tmp_path, change, said):
    shown = with_columns(recorded, tmp_path, change)
    with pytest.raises(InvalidInputError, match=rf"000002\.safetensors'.*{said}"):
        shown.check(Point())


def test_recorded_episodes_fit_and_actions_may_be_a_thousandth_out_of_bounds(recorded, tmp_path):
    Demonstrations(recorded).check(Point())
    with_columns(recorded, tmp_path, {"action": np.full((LENGTH, 1), 1.0009 * STEP, np.float32)}).check(Point())


def test_an_index_without_episodes_of_other_lengths_or_of_no_safetensors_is_refused(recorded, tmp_path):
    shown = with_columns(recorded, tmp_path, {})
    index = json.loads((tmp_path / INDEX).read_text())
    index["episodes"][2]["length"] = 2
    (tmp_path / INDEX).write_text(json.dumps(index))
    with pytest.raises(InvalidInputError, match=r"000002\.safetensors'.* of 2 steps"):
        Demonstrations(tmp_path).check(Point())
    path = tmp_path / index["episodes"][2]["file"]
    path.write_bytes(b"nothing")
    index["episodes"][2]["sha256"] = digest(path)
    (tmp_path / INDEX).write_text(json.dumps(index))
    with pytest.raises(InvalidInputError, match=r"000002\.safetensors': expected safetensors"):
        Demonstrations(tmp_path).check(Point())
    (tmp_path / INDEX).write_text(json.dumps(index | {"episodes": []}))
    with pytest.raises(InvalidInputError, match="at least one episode"):
        Demonstrations(tmp_path).check(Point())
    assert len(shown) == 5


class _Choosing(Point):
    action_space = Discrete(3)


@pytest.mark.parametrize(("last", "fits"), [(2, True), (3, False), (-1, False)])
def test_choices_are_those_of_the_task(recorded, tmp_path, last, fits):
    shown = with_columns(recorded, tmp_path, {"action": np.array([0] * (LENGTH - 1) + [last])}, episodes=range(5))
    if fits:
        shown.check(_Choosing())
        return
    with pytest.raises(InvalidInputError, match=rf"in Discrete\(3\), got {last} in step {LENGTH - 1}"):
        shown.check(_Choosing())


def with_columns(
    recorded: Path, folder: Path, change: dict[str, Any], episodes: Sequence[int] = (2,)
) -> Demonstrations:
    """A copy, of which some episodes have other columns; those that are None are left out."""
    shutil.copytree(recorded, folder, dirs_exist_ok=True)
    index = json.loads((folder / INDEX).read_text())
    for entry in (index["episodes"][number] for number in episodes):
        path = folder / entry["file"]
        columns = {name: one for name, one in (load_file(path) | change).items() if one is not None}
        save_file(columns, path)
        entry["sha256"] = digest(path)
    (folder / INDEX).write_text(json.dumps(index))
    return Demonstrations(folder)


class _CarelessEnv(LockEnv):
    """Its expert sets the last dial wrong in every other episode."""

    episodes = 0

    def reset(self, **options: Any) -> Any:
        self.episodes += 1
        return super().reset(**options)

    def expert_action(self) -> Any:
        wrong = self.done == self.DIALS - 1 and self.episodes % 2
        return -self.observation()[:1] if wrong else self.observation()[:1]


class _Careless(Lock):
    def make_env(self, rank: int) -> Any:
        return _CarelessEnv()


@pytest.mark.parametrize(("successes_only", "successes"), [(True, [True] * 4), (False, [False, True] * 2)])
def test_only_successes_may_be_kept(tmp_path, successes_only, successes):
    demonstrations = record_demonstrations(_Careless(), tmp_path, 4, expert="careless", successes_only=successes_only)
    assert [episode.success for episode in demonstrations.index.episodes] == successes
