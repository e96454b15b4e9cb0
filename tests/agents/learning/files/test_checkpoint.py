"""Checkpoints: whole or not at all, the newest two, and never code."""

from __future__ import annotations

import os
import pickle
import signal
import time
from enum import StrEnum
from pathlib import Path

import numpy as np
import pytest
import torch

from dohyo.agents.learning.files import checkpoint
from dohyo.agents.learning.files.checkpoint import (
    generator_of,
    generator_state,
    load_checkpoint,
    random_state,
    save_checkpoint,
)
from dohyo.sumo_networks.errors import InvalidInputError
from tests.forked import Python

ROOT = Path(__file__).parents[4]


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_newest_two_are_kept_and_the_newest_is_read(tmp_path):
    for steps in (9, 1000, 20):
        save_checkpoint(tmp_path, steps, {"steps": steps, "weights": torch.full((3,), float(steps))})
    assert names(tmp_path) == ["checkpoint-000000000020.pt", "checkpoint-000000001000.pt"]
    assert load_checkpoint(tmp_path)["weights"].tolist() == [1000.0] * 3


def test_there_may_be_none_yet(tmp_path):
    (tmp_path / "checkpoint-3.pt.tmp").write_bytes(b"no name of ours")
    assert load_checkpoint(tmp_path) is None


class Ending(StrEnum):
    COLLISION = "collision"


def test_a_state_that_could_not_be_read_again_is_refused_and_nothing_is_written(tmp_path):
    with pytest.raises(pickle.UnpicklingError, match="Ending"):
        save_checkpoint(tmp_path, 1, {"measures": {Ending.COLLISION: 1.0}})
    assert names(tmp_path) == []


@pytest.mark.parametrize("step", ["write", "sync", "rename"])
def test_a_write_that_fails_leaves_the_old_one_and_no_scraps(step, tmp_path, monkeypatch):
    save_checkpoint(tmp_path, 1, {"steps": 1})

    def refuse(*arguments: object, **options: object) -> None:
        raise OSError("the disk is full")

    with monkeypatch.context() as patch:
        target = {"write": (Path, "write_bytes"), "sync": (os, "fsync"), "rename": (os, "replace")}[step]
        patch.setattr(*target, refuse)
        with pytest.raises(OSError, match="full"):
            save_checkpoint(tmp_path, 2, {"steps": 2})
    assert names(tmp_path) == ["checkpoint-000000000001.pt"]
    assert load_checkpoint(tmp_path) == {"steps": 1}


def test_a_process_killed_while_it_writes_leaves_a_whole_one(tmp_path):
    code = f"""
import torch
from pathlib import Path
from dohyo.agents.learning.files.checkpoint import save_checkpoint
for steps in range(10_000):
    save_checkpoint(Path({str(tmp_path)!r}), steps, dict(steps=steps, weights=torch.full((400_000,), float(steps))))
"""
    writer = Python(code)
    writer.wait_for(lambda: any(path.name.endswith("3.pt") for path in tmp_path.iterdir()))
    time.sleep(0.037)
    assert writer.end(signal.SIGKILL) == -signal.SIGKILL
    state = load_checkpoint(tmp_path)
    assert (state["weights"] == state["steps"]).all()


def test_a_damaged_one_gives_way_to_the_one_before(tmp_path, caplog):
    save_checkpoint(tmp_path, 1, {"steps": 1})
    newest = save_checkpoint(tmp_path, 2, {"steps": 2, "weights": torch.zeros(100)})
    newest.write_bytes(newest.read_bytes()[:-200])
    assert load_checkpoint(tmp_path) == {"steps": 1}
    assert "is damaged" in caplog.text
    (tmp_path / "checkpoint-000000000001.pt").write_bytes(b"")
    with pytest.raises(InvalidInputError, match=r"every checkpoint in .* is damaged"):
        load_checkpoint(tmp_path)


class Bomb:
    def __reduce__(self):
        return os.mkdir, ("boom",)


def test_a_checkpoint_cannot_run_code(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "checkpoint-000000000001.pt").write_bytes(pickle.dumps(Bomb(), protocol=2))
    torch.save({"x": Bomb()}, tmp_path / "checkpoint-000000000002.pt")
    with pytest.raises(InvalidInputError, match="damaged"):
        load_checkpoint(tmp_path)
    assert not (tmp_path / "boom").exists()


def test_generators_go_on_where_they_were(tmp_path):
    generator = np.random.default_rng(5)
    generator.normal(size=7)
    torch.manual_seed(5)
    save_checkpoint(tmp_path, 1, {"numpy": generator_state(generator), "random": random_state()})
    expected = generator.normal(size=4), torch.randn(4)
    state = load_checkpoint(tmp_path)
    checkpoint.restore_random_state(state["random"])
    assert (generator_of(state["numpy"]).normal(size=4) == expected[0]).all()
    assert (torch.randn(4) == expected[1]).all()
