"""The examples of learning run as they stand, for a few steps."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from dohyo.agents.learning.files.card import read_card

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("learn_*.py"))
LINES_AT_MOST = 20


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_learns_from_a_few_steps(example: Path, tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "ignore"}
    command = [sys.executable, str(example), "64"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=300, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert "mean reward" in done.stdout or "ep_rew_mean" in done.stdout or "total_timesteps" in done.stdout


def test_an_example_fits_twenty_lines() -> None:
    assert {path.stem for path in EXAMPLES} == {"learn_sb3", "learn_plain", "learn_torchrl"}
    for path in EXAMPLES:
        code = [line for line in path.read_text().splitlines() if line and not line.startswith(("import", "from", '"'))]
        assert len(code) <= LINES_AT_MOST, f"{path.name} has {len(code)} lines without its imports"


def dohyo(*arguments: str, cwd: Path) -> str:
    program = "from dohyo.service.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=600,
        env=os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.slow
def test_a_policy_of_ones_own_is_trained_and_drives(tmp_path: Path) -> None:
    short = ["--set", "steps=64", "--set", "ppo.horizon=64", "--set", "device=cpu"]
    dohyo("train", "examples.follower:FOLLOWER", *short, "--out", "runs/follower", cwd=tmp_path)
    assert read_card(tmp_path / "runs/follower/best.onnx").steps in (0, 64)
    drive = ["--agent", "examples.follower:Follower", "--benchmark", "quickstart", "--only", "right-to-south"]
    printed = json.loads(dohyo("evaluate", *drive, "--seeds", "0", "--json", cwd=tmp_path))
    assert [one["failure"] for one in printed["drives"]] == [None]
    assert printed["part"] == "part of quickstart: 1 of 6 missions"


@pytest.mark.slow
def test_an_algorithm_of_ones_own_learns_and_resumes(tmp_path: Path) -> None:
    out = ["--out", "runs/reinforce"]
    run = ["examples.reinforce:REINFORCE", *out, "--set", "device=cpu", "--set", "tensorboard=false"]
    dohyo("train", *run, "--set", "steps=16384", cwd=tmp_path)
    dohyo("train", *run, "--set", "steps=20480", "--resume", cwd=tmp_path)
    with (tmp_path / "runs/reinforce/evaluations.csv").open() as file:
        returns = [float(row["return"]) for row in csv.DictReader(file)]
    assert returns[-1] > 3 * returns[0]
