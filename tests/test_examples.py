"""The examples of learning run as they stand, for a few steps."""

from __future__ import annotations

import csv
import json
import os
import re
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from dohyo.agents.learning.files.card import read_card
from tests.forked import Python, dohyo

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("learn_*.py"))
LINES_AT_MOST = 20
SCRIPT = "import runpy, sys; sys.argv.pop(0); runpy.run_path(sys.argv[0], run_name='__main__')"
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_learns_from_a_few_steps(example: Path, tmp_path: Path) -> None:
    process = Python(SCRIPT, str(example), "64", cwd=tmp_path, env=ENVIRONMENT)
    assert process.end() == 0, process.errors()[-2000:]
    said = process.output()
    assert "mean reward" in said or "ep_rew_mean" in said or "total_timesteps" in said


def test_a_loop_without_steps_is_refused() -> None:
    process = Python(SCRIPT, "examples/learn_plain.py", "0", env=ENVIRONMENT)
    assert process.end() == 1
    assert process.errors() == "expected at least one step, got 0\n"


class Restarting(BaseHTTPRequestHandler):
    """A proxy before a service that is restarted."""

    tries = 0

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["content-length"]))
        self.send_error(503)
        Restarting.tries += 1

    def log_message(self, *_: object) -> None:
        pass


def test_a_forecaster_says_once_why_it_waits_and_for_whom() -> None:
    with HTTPServer(("127.0.0.1", 0), Restarting) as proxy:
        threading.Thread(target=proxy.serve_forever).start()
        url = f"http://127.0.0.1:{proxy.server_port}"
        process = Python(SCRIPT, "examples/forecaster.py", url, "token", "mine", env=ENVIRONMENT)
        process.wait_for(lambda: Restarting.tries >= 4)
        process.kill()
        process.end()
        proxy.shutdown()
    (line,) = process.errors().splitlines()
    assert line.startswith(f"{url}: ")


@pytest.mark.parametrize("name", ["forecaster", "planner", "onnx_policy", "carla_bridge"])
def test_a_program_without_its_arguments_says_how_it_is_called(name: str) -> None:
    paths = ENVIRONMENT | {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'examples'}"}
    process = Python(SCRIPT, str(ROOT / "examples" / f"{name}.py"), cwd=ROOT, env=paths)
    assert process.end() == 1
    told = process.errors()
    assert "Traceback" not in told
    assert re.search(rf"python \S*{name}\.py \S", told)


def test_an_example_fits_twenty_lines() -> None:
    assert {path.stem for path in EXAMPLES} == {"learn_sb3", "learn_plain", "learn_torchrl"}
    for path in EXAMPLES:
        code = [line for line in path.read_text().splitlines() if line and not line.startswith(("import", "from", '"'))]
        assert len(code) <= LINES_AT_MOST, f"{path.name} has {len(code)} lines without its imports"


def run(*arguments: str, cwd: Path) -> str:
    process = dohyo(*arguments, cwd=cwd, env=ENVIRONMENT)
    assert process.end() == 0, process.errors()[-2000:]
    return process.output()


@pytest.mark.slow
def test_a_policy_of_ones_own_is_trained_and_drives(tmp_path: Path) -> None:
    short = ["--set", "steps=64", "--set", "ppo.horizon=64", "--set", "device=cpu"]
    run("train", "examples.follower:FOLLOWER", *short, "--out", "runs/follower", cwd=tmp_path)
    assert read_card(tmp_path / "runs/follower/best.onnx").steps in (0, 64)
    drive = ["--agent", "examples.follower:Follower", "--benchmark", "quickstart", "--only", "right-to-south"]
    printed = json.loads(run("evaluate", *drive, "--seeds", "0", "--json", cwd=tmp_path))
    assert [one["failure"] for one in printed["drives"]] == [None]
    assert printed["part"] == "part of quickstart: 1 of 6 missions"


@pytest.mark.slow
def test_an_algorithm_of_ones_own_learns_and_resumes(tmp_path: Path) -> None:
    out = ["--out", "runs/reinforce"]
    order = ["examples.reinforce:REINFORCE", *out, "--set", "device=cpu", "--set", "tensorboard=false"]
    run("train", *order, "--set", "steps=16384", cwd=tmp_path)
    run("train", *order, "--set", "steps=20480", "--resume", cwd=tmp_path)
    with (tmp_path / "runs/reinforce/evaluations.csv").open() as file:
        returns = [float(row["return"]) for row in csv.DictReader(file)]
    assert returns[-1] > 3 * returns[0]
