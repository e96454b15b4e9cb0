"""Replay: what is sampled is what was added, frames are stored once, and a killed run goes on to the bit."""

from __future__ import annotations

import random
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Dict, Discrete
from tensordict import TensorDict, TensorDictBase

from dohyo.agents.learning.experience.replay import Replay, ReplayConfig
from dohyo.sumo_networks.errors import InvalidInputError
from tests.forked import Python

VECTOR = Box(-np.inf, np.inf, (2,), np.float32)
PICTURE = Box(0, 255, (3, 4, 4), np.uint8)
GAMMA = 0.9


def make(folder: Path, *, slack: int = 100, observation: Any = VECTOR, **settings: Any) -> Replay:
    names = ("stack", "extras", "seed", "entries")
    own = {name: settings.pop(name) for name in names if name in settings}
    spaces = Dict({"seen": observation}), Discrete(5)
    return Replay(folder / "replay", spaces, ReplayConfig(**settings), gamma=GAMMA, slack=slack, **{"seed": 0} | own)


class Row(NamedTuple):
    """What one row does in a step; its observations are (episode, time) and (episode, time + 1)."""

    episode: int
    time: int
    end: str = ""  # "terminated", "truncated" or ""
    active: bool = True
    source: int = 0


def reward_of(episode: int, time: int) -> float:
    return episode + time / 8


def step_of(*rows: Row, frames: Any = None, **extras: torch.Tensor) -> TensorDict:
    def seen(later: int) -> TensorDict:
        pairs = [(row.episode, row.time + later) for row in rows]
        values = torch.stack([frames(*pair) for pair in pairs]) if frames else torch.tensor(pairs).float()
        return TensorDict({"seen": values}, [len(rows)])

    def column(values: list[Any]) -> torch.Tensor:
        return torch.tensor(values)[:, None]

    after = {name: column([row.end == name for row in rows]) for name in ("terminated", "truncated")}
    rewards = column([reward_of(row.episode, row.time) for row in rows])
    return TensorDict(
        {
            "observation": seen(0),
            "action": torch.tensor([row.time % 5 for row in rows]),
            "source": torch.tensor([row.source for row in rows], dtype=torch.uint8),
            "active": torch.tensor([row.active for row in rows]),
            "episode": torch.tensor([row.episode for row in rows]),
            "next": {
                "observation": seen(1),
                "reward": rewards,
                "done": after["terminated"] | after["truncated"],
                **after,
            },
            **extras,
        },
        [len(rows)],
    )


def episode(replay: Replay, number: int, length: int, end: str = "truncated", **others: Any) -> None:
    for time_ in range(length):
        replay.add(step_of(Row(number, time_, end if time_ == length - 1 else ""), **others))


def rows_of(batch: TensorDictBase) -> set[tuple[float, ...]]:
    """Each transition as episode, time, reward, terminated, done, steps, episode and time of the next observation."""
    after = batch["next"]
    columns = [
        *(batch["observation", "seen"].T, after["reward"].T, after["terminated"].T, after["done"].T),
        *(after["steps_to_next_obs"].T, after["observation", "seen"].T),
    ]
    return {tuple(row.tolist()) for row in torch.cat([column.float() for column in columns]).T}


def test_all_transitions_are_sampled_and_nothing_else(tmp_path: Path) -> None:
    replay = make(tmp_path)
    episode(replay, 1, 2, "terminated")
    replay.add(step_of(Row(2, 0)))
    assert rows_of(replay.sample(200)) == {
        (1, 0, 1.0, 0, 0, 1, 1, 1),
        (1, 1, 1.125, 1, 1, 1, 1, 2),
        (2, 0, 2.0, 0, 0, 1, 2, 1),
    }


def test_returns_of_three_steps_by_hand(tmp_path: Path) -> None:
    replay = make(tmp_path, steps=3)
    episode(replay, 1, 4, "terminated")
    episode(replay, 2, 2, "truncated")
    r = [1.0, 1.125, 1.25, 1.375]
    expected = {
        (1, 0, r[0] + 0.9 * r[1] + 0.81 * r[2], 0, 0, 3, 1, 3),
        (1, 1, r[1] + 0.9 * r[2] + 0.81 * r[3], 1, 1, 3, 1, 4),
        (1, 2, r[2] + 0.9 * r[3], 1, 1, 2, 1, 4),
        (1, 3, r[3], 1, 1, 1, 1, 4),
        (2, 0, 2.0 + 0.9 * 2.125, 0, 1, 2, 2, 2),
        (2, 1, 2.125, 0, 1, 1, 2, 2),
    }
    found = {tuple(round(value, 5) for value in row) for row in rows_of(replay.sample(400))}
    assert found == {tuple(round(value, 5) for value in row) for row in expected}


def test_a_row_that_pauses_begins_a_new_chain(tmp_path: Path) -> None:
    replay = make(tmp_path, steps=5)
    replay.add(step_of(Row(1, 0), Row(2, 0)))
    replay.add(step_of(Row(1, 1), Row(2, 1, active=False)))
    replay.add(step_of(Row(1, 2), Row(2, 2)))
    found = {(int(row[0]), int(row[1]), int(row[5])) for row in rows_of(replay.sample(300))}
    assert found == {(1, 0, 3), (1, 1, 2), (1, 2, 1), (2, 0, 1), (2, 2, 1)}


def test_the_window_forgets_the_oldest(tmp_path: Path) -> None:
    replay = make(tmp_path, capacity=20, slack=7)
    for number in range(40):
        episode(replay, number, 3)  # four entries each
        assert {row[0] for row in rows_of(replay.sample(300))} == set(range(max(0, number - 4), number + 1))
    assert len(replay) == 20


def frame(number: int, time_: int) -> torch.Tensor:
    return torch.full((1, 4, 4), 10 * number + time_, dtype=torch.uint8)


def stacked(number: int, time_: int) -> torch.Tensor:
    return torch.cat([frame(number, max(0, time_ - back)) for back in (2, 1, 0)])


def test_stacks_of_frames_never_cross_an_episode(tmp_path: Path) -> None:
    replay = make(tmp_path, observation=PICTURE, stack=3)
    for number in range(3):
        episode(replay, number, 5, frames=stacked)
    frames = {name: np.stack([frame(3, time_).numpy() for time_ in range(3)]) for name in ("seen",)}
    replay.add_episode(frames, np.zeros(2), np.zeros(2), terminated=True, source=1)
    batch = replay.sample(500)
    stacks = batch["observation", "seen"][:, :, 0, 0]
    after = batch["next", "observation", "seen"][:, :, 0, 0]
    expected = {(n, t): stacked(n, t)[:, 0, 0].tolist() for n in range(4) for t in range(6)}
    for stack, later in zip(stacks.tolist(), after.tolist(), strict=True):
        number, time_ = divmod(stack[-1], 10)
        assert (stack, later) == (expected[number, time_], expected[number, time_ + 1])
    assert len({tuple(stack) for stack in stacks.tolist()}) == 3 * 5 + 2


def test_stacks_end_at_the_windows_first_entry(tmp_path: Path) -> None:
    replay = make(tmp_path, observation=PICTURE, stack=3, capacity=4)
    episode(replay, 1, 8, frames=stacked)
    stacks = {tuple(stack) for stack in replay.sample(100)["observation", "seen"][:, :, 0, 0].tolist()}
    assert stacks == {(15, 15, 15), (15, 15, 16), (15, 16, 17)}


def test_a_share_of_the_batch_comes_from_a_source(tmp_path: Path) -> None:
    replay = make(tmp_path)
    episode(replay, 0, 90)
    assert (replay.sample(8, {1: 0.5})["source"] == 0).all()  # a source without transitions gives up its share
    replay.add_episode({"seen": np.zeros((3, 2))}, np.zeros(2), np.ones(2), terminated=True, source=1)
    batch = replay.sample(64, {1: 0.25})
    assert (batch["source"] == 1).sum() == 16
    assert (batch["next", "reward"][batch["source"] == 1] == 1.0).all()
    shares = replay.sample(20_000)["source"].float().mean()
    assert shares == pytest.approx(2 / 92, abs=0.005)


def test_priorities_decide_the_draws_and_weights_correct_them(tmp_path: Path) -> None:
    replay = make(tmp_path, priority=0.5, correction=1.0)
    episode(replay, 0, 4)
    first = replay.sample(100)
    assert (first["weight"] == 1.0).all()
    errors = torch.tensor([1.0, 4.0, 9.0, 16.0])
    replay.prioritise(torch.arange(4), errors)
    batch = replay.sample(20_000)
    times = batch["observation", "seen"][:, 1].long()
    assert torch.bincount(times).numpy() / 20_000 == pytest.approx(np.arange(1, 5) / 10, abs=0.015)
    assert batch["weight"].numpy() == pytest.approx(1.0 / (times.numpy() + 1.0), rel=1e-5)
    episode(replay, 1, 1)  # a new transition has the highest priority so far
    assert (replay.sample(20_000)["episode"] == 1).float().mean() == pytest.approx(4 / 14, abs=0.015)


def test_uniform_draws_are_uniform(tmp_path: Path) -> None:
    replay = make(tmp_path)
    for number in range(10):
        episode(replay, number, 1 + number % 3)
    counts = np.unique(replay.sample(40_000)["index"].numpy(), return_counts=True)[1]
    assert len(counts) == 19
    assert counts / 40_000 == pytest.approx(np.full(19, 1 / 19), abs=0.005)


def test_extras_are_kept_where_given_and_zero_elsewhere(tmp_path: Path) -> None:
    replay = make(tmp_path, capacity=4, slack=1, extras={"label": torch.zeros(2)})
    for number in range(4):
        given = {"label": torch.full((1, 2), 7.0)} if number % 2 else {}
        replay.add(step_of(Row(number, 0, "truncated"), **given))
    batch = replay.sample(50)
    assert set(zip(batch["episode"].tolist(), batch["label"][:, 0].tolist(), strict=True)) == {(2, 0.0), (3, 7.0)}


def test_a_pixel_transition_takes_one_frame_and_the_vectors(tmp_path: Path) -> None:
    side, count = 64, 1000
    space = Box(0, 255, (9, side, side), np.uint8)
    replay = make(tmp_path, observation=space, stack=3, capacity=count, slack=0)
    replay.add(step_of(Row(0, 0), frames=lambda *_: torch.zeros(space.shape, dtype=torch.uint8)))
    stored = sum(path.stat().st_size for path in (tmp_path / "replay").rglob("*.memmap"))
    vectors = 8 + 4 + 1 + 1 + 1 + 4 * 8  # action, reward, source, terminated, truncated, and four numbers of the links
    assert stored / count == 3 * side * side + vectors


def test_too_little_slack_is_refused_before_a_checkpoint_is_damaged(tmp_path: Path) -> None:
    replay = make(tmp_path, capacity=20, slack=8)
    for number in range(10):
        episode(replay, number, 3)
    replay.state()
    episode(replay, 10, 3)
    replay.state()
    episode(replay, 11, 3)
    with pytest.raises(InvalidInputError, match="slack"):
        episode(replay, 12, 3)


def test_an_empty_replay_and_one_without_its_files_are_refused(tmp_path: Path) -> None:
    replay = make(tmp_path)
    with pytest.raises(InvalidInputError, match="at least one transition"):
        replay.sample(1)
    episode(replay, 0, 3)
    with pytest.raises(InvalidInputError, match="no replay"):
        make(tmp_path / "elsewhere").restore(replay.state())


# The disk

BYTES = 2 * 4 + 8 + 4 + 1 + 1 + 1 + 4 * 8
"""Of an entry: observation, action, reward, source, terminated, truncated, and four numbers of the links."""


def leave(free: int, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil.disk_usage("/")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=free))


def test_a_disk_without_room_is_refused_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave(1100 * BYTES - 1, monkeypatch)
    message = rf"disk of '{tmp_path}/replay' is too full: expected {1100 * BYTES:,} bytes free, "
    message += rf"got {1100 * BYTES - 1:,}; a smaller replay\.capacity \(now 1000\)"
    with pytest.raises(InvalidInputError, match=message):
        make(tmp_path, capacity=1000)
    assert not list(tmp_path.iterdir())
    leave(1100 * BYTES, monkeypatch)
    make(tmp_path, capacity=1000)


def test_a_run_needs_room_for_its_own_steps_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    leave(50 * BYTES, monkeypatch)
    make(tmp_path, capacity=1000, entries=50)
    with pytest.raises(InvalidInputError, match=f"expected {51 * BYTES:,} bytes"):
        make(tmp_path, capacity=1000, entries=51)


def test_a_resumed_run_needs_room_for_what_is_not_on_the_disk_yet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replay = make(tmp_path, capacity=100_000)
    for _ in range(2):
        episode(replay, 1, 2)
    leave(100_100 * BYTES - 1024 * BYTES, monkeypatch)  # the rest has blocks already
    make(tmp_path, capacity=100_000).restore(replay.state())
    with pytest.raises(InvalidInputError, match="too full"):
        make(tmp_path / "another", capacity=100_000)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("no file system can be mounted here: a full disk needs root")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def fill_the_disk(folder: Path) -> None:
    """Adds episodes until the disk is full; called in a process of its own."""
    replay = make(folder, capacity=100_000, entries=1)
    try:
        for number in range(1000):
            observations = {"seen": np.full((101, 2), float(number))}
            replay.add_episode(observations, np.zeros(100), np.zeros(100), terminated=False, source=0)
    except OSError as error:
        print(f"'{error.filename}': {error.strerror}; the last is {replay.sample(1000)['observation', 'seen'].max()}")


@pytest.mark.slow
def test_a_disk_that_becomes_full_is_an_error_and_what_was_added_stays(small_disk: Path) -> None:
    command = "import sys, pathlib; from tests.agents.learning.experience.test_replay import fill_the_disk as fill; "
    child = Python(f"{command} fill(pathlib.Path(sys.argv[1]))", str(small_disk))
    assert child.end() == 0, child.errors()
    assert f"'{small_disk}/replay/" in child.output()
    assert "No space left on device; the last is 1" in child.output()


# A run that is killed

SETTINGS: dict[str, Any] = {
    "capacity": 300,
    "slack": 500,
    "steps": 3,
    "priority": 0.6,
    "observation": PICTURE,
    "stack": 3,
}
EVERY, BATCH = 50, 32


def producer(replay: Replay, rounds: range) -> Iterator[list[torch.Tensor]]:
    """Rounds of 50 steps in two rows, cut at their ends; each step is a function of its number. Yields the samples."""
    for round_ in rounds:
        samples = []
        for index in range(EVERY):
            cut = "truncated" if index == EVERY - 1 else ""
            ends = [cut or ("terminated" if index % length == length - 1 else "") for length in (7, 12)]
            rows = [
                Row(round_ * 100 + index // length * 2 + row, index % length, end, source=row)
                for row, (length, end) in enumerate(zip((7, 12), ends, strict=True))
            ]
            replay.add(step_of(*rows, frames=lambda number, time_: stacked(number % 20, time_)))
            batch = replay.sample(BATCH, {1: 0.25})
            replay.prioritise(batch["index"], batch["next", "reward"].squeeze(-1) + batch["action"])
            samples += [batch["index"], batch["weight"]]
            samples += [batch["observation", "seen"], batch["next", "observation", "seen"]]
        yield samples


def run_until_killed(folder: Path) -> None:
    """Runs and writes checkpoints for ever; called in a process of its own."""
    replay = make(folder, **SETTINGS)
    for round_ in range(10**6):
        list(producer(replay, range(round_, round_ + 1)))
        torch.save({"round": round_, "replay": replay.state()}, folder / "new.pt")
        (folder / "new.pt").replace(folder / "checkpoint.pt")


@pytest.mark.slow
def test_a_run_killed_at_a_random_moment_samples_on_to_the_bit(tmp_path: Path) -> None:
    command = "import sys, pathlib; from tests.agents.learning.experience.test_replay import run_until_killed as run; "
    command += "run(pathlib.Path(sys.argv[1]))"
    child = Python(command, str(tmp_path))
    child.wait_for((tmp_path / "checkpoint.pt").exists)
    time.sleep(random.uniform(0.0, 0.1))
    assert child.end(signal.SIGKILL) == -signal.SIGKILL
    checkpoint = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    resumed, whole = make(tmp_path, **SETTINGS), make(tmp_path / "whole", **SETTINGS)
    resumed.restore(checkpoint["replay"])
    begin = checkpoint["round"] + 1
    for _ in producer(whole, range(begin)):
        whole.state()
    rest = range(begin, begin + 8)
    for one, other in zip(producer(resumed, rest), producer(whole, rest), strict=True):
        assert all(torch.equal(a, b) for a, b in zip(one, other, strict=True))
        resumed.state(), whole.state()
