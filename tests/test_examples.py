"""The examples of learning run as they stand, for a few steps."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

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
