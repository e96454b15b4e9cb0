"""The comparison of two runs' folders: it finds a single bit, and leaves times out."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from tensordict import TensorDict

from tests.agents.learning.killed import different


def change(path: Path) -> None:
    found = torch.load(path)
    found["wall_s"] += 1.0
    found["learner"]["optimizer"]["state"][0]["exp_avg"][1] *= -1.0
    torch.save(found, path)


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    one, other = tmp_path / "one", tmp_path / "other"
    TensorDict({"seen": torch.zeros(3, 2, 2, dtype=torch.uint8)}, [3]).memmap(str(one / "replay"))
    moments = {"exp_avg": torch.tensor([float("nan"), 0.0]), "step": 3}
    torch.save({"wall_s": 1.0, "learner": {"optimizer": {"state": [moments]}}}, one / "checkpoint-000000000001.pt")
    save_file({"weight": torch.ones(2)}, one / "policy.safetensors", {"steps": "1"})
    (one / "result.json").write_text(json.dumps({"wall_s": 1.0, "last": {"return": -1.5}}))
    (one / "metrics.csv").write_text("steps\n1\n")
    shutil.copytree(one, other)
    return one, other


def test_what_is_the_same_but_for_its_time_has_no_differences(folders: tuple[Path, Path]) -> None:
    one, other = folders
    (other / "result.json").write_text(json.dumps({"wall_s": 2.0, "last": {"return": -1.5}}))
    (other / "timing.csv").write_text("steps,wall_s\n")
    assert different(one, other) == []


def test_each_kind_of_difference_is_found_and_told(folders: tuple[Path, Path]) -> None:
    one, other = folders
    TensorDict.load_memmap(other / "replay")["seen"][2, 1, 1] = 1
    change(other / "checkpoint-000000000001.pt")
    save_file({"weight": torch.ones(2)}, other / "policy.safetensors", {"steps": "2"})
    (other / "result.json").write_text(json.dumps({"wall_s": 1.0, "last": {"return": -1}}))
    (other / "metrics.csv").unlink()
    assert different(one, other) == [
        "metrics.csv",
        "checkpoint-000000000001.pt: learner.optimizer.state[0].exp_avg",
        "policy.safetensors: facts.steps",
        "replay/seen.memmap",
        "result.json: last.return",
    ]
