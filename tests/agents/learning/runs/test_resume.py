"""Resumption of real processes: whatever ends one, the curve comes out the same."""

from __future__ import annotations

import csv
import json
import os
import signal
import sys
import time
from pathlib import Path

import pytest
import torch
from safetensors import safe_open

from dohyo.agents.learning.algorithms.ppo import Ppo
from dohyo.agents.learning.files.card import WEIGHTS, read_card
from dohyo.agents.learning.files.report import Report, no_report
from dohyo.agents.learning.runs import training
from dohyo.agents.learning.runs.evaluation import Evaluation
from dohyo.agents.learning.runs.run import RunStoppedError
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.service.cli import main
from tests.agents.learning.killed import different
from tests.agents.learning.toys import POINT, PointConfig
from tests.forked import MAIN, PATIENCE_S, Python, dohyo


def rows(folder: Path) -> int:
    path = folder / "metrics.csv"
    return len(list(csv.reader(path.open()))) - 1 if path.exists() else 0


def order(toy: str, out: Path, *arguments: str) -> list[str]:
    return ["train", f"tests.agents.learning.toys:{toy}", "--out", str(out), *arguments]


def descendants(pid: int) -> list[int]:
    """Its server of processes, the workers that this has forked, and others."""
    children = [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return [*children, *(one for child in children for one in descendants(child))]


def alive(pid: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False


HALTS = """
import os, time
from pathlib import Path
from dohyo.agents.learning.files.metrics import Table

add, halts, rows = Table.add, Path(os.environ["HALTS"]), int(os.environ["HALTS_AT"])

def halting(self, steps, values):
    add(self, steps, values)
    while self._path.name == "metrics.csv" and self._path.read_text().count("\\n") == 1 + rows and halts.exists():
        time.sleep(0.01)

Table.add = halting
"""
"""A training that goes no further than to a row of its metrics while a file is there."""


def halting(halts: Path, at: int, *arguments: str) -> Python:
    halts.touch()
    return Python(HALTS + MAIN, *arguments, env=os.environ | {"HALTS": str(halts), "HALTS_AT": str(at)})


GUIDED = ("--set=ppo.guided_share=0.3",)
LEARNED_BEFORE = ("--set=ppo.imitated_steps=256", "--set=ppo.normalised=true")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("toy", "settings"),
    [
        ("POINT", ("--set=slow_s=0.002", *GUIDED, *LEARNED_BEFORE, "--set=processes=2", "--set=ppo.horizon=64")),
        ("STREET", ("--set=processes=1", "--set=steps=640", "--set=evaluate_every=256", "--set=ppo.horizon=32")),
    ],
)
def test_a_run_that_was_stopped_and_killed_gives_the_same_curve(toy, settings, tmp_path, monkeypatch):
    whole, out, halts = tmp_path / "whole", tmp_path / "disturbed", tmp_path / "halts"
    monkeypatch.setattr(sys, "argv", ["dohyo", *order(toy, whole, *settings)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (None, 0)

    stopped = halting(halts, 3, *order(toy, out, *settings))
    stopped.wait_for(lambda: rows(out) >= 2)
    stopped.send_signal(signal.SIGTERM)
    halts.unlink()
    assert stopped.end() == 130
    said = stopped.errors()
    assert said.endswith("\n")
    last = said.splitlines()[-1]  # lines of progress may come before it
    assert last.startswith("dohyo: stopped at step ")
    assert f"--resume --out {out}" in last

    before = rows(out)
    killed = halting(halts, rows(whole) - 1, *order(toy, out, "--resume"))
    killed.wait_for(lambda: rows(out) >= before + 3)  # beyond a checkpoint
    below = descendants(killed.pid)
    assert len(below) >= 3
    assert killed.end(signal.SIGKILL) == -signal.SIGKILL
    assert before + 3 <= rows(out) < rows(whole)
    patience = time.monotonic() + PATIENCE_S
    while any(map(alive, below)):
        assert time.monotonic() < patience
        time.sleep(0.01)

    assert dohyo(*order(toy, out, "--resume")).end() == 0
    assert different(whole, out) == []


def test_an_evaluation_that_no_checkpoint_knows_of_is_told_once(tmp_path, monkeypatch):
    """Stopped where an evaluation is due, and killed after it: it comes again, its row does not."""

    def run(resume: bool) -> None:
        POINT.train(PointConfig(), TrainRequest("toy", tmp_path / "run", resume, no_report))

    def evaluated() -> list[str]:
        with (tmp_path / "run" / "evaluations.csv").open() as file:
            return [row["steps"] for row in csv.DictReader(file)]

    whole = training.evaluate

    def stopped(task, environments, act, stopping):
        if evaluated():
            raise RunStoppedError("stopped")
        return whole(task, environments, act, stopping)

    def dies(self):
        raise RuntimeError("killed")

    with monkeypatch.context() as patched:
        patched.setattr(training, "evaluate", stopped)
        with pytest.raises(RunStoppedError):
            run(resume=False)
    with monkeypatch.context() as patched:
        patched.setattr(Ppo, "round", dies)
        with pytest.raises(RuntimeError, match="killed"):
            run(resume=True)
    assert evaluated() == ["0", "512"]
    run(resume=True)
    assert evaluated() == ["0", "512", "1024"]


class KilledError(Exception):
    """Ends a training in the midst of a round."""


def trained(out: Path, steps: int, killed_at: int | None = None) -> None:
    """Trains a point with checkpoints every 512 steps, and evaluations every 256."""

    def report(now: Report) -> None:
        if killed_at is not None and now.steps >= killed_at:
            raise KilledError

    config = PointConfig(steps=steps, evaluate_every=256, checkpoint_every=512)
    resume = (out / "config.toml").exists()
    if killed_at is None:
        POINT.train(config, TrainRequest("toy", out, resume, report))
    else:
        with pytest.raises(KilledError):
            POINT.train(config, TrainRequest("toy", out, resume, report))


def best_of(out: Path) -> int:
    """Steps of the best policy, by the result, the files and their cards, which agree."""
    result = json.loads((out / "result.json").read_text())
    for model, row in (("best", result["best"]), ("policy", result["last"])):
        for suffix in WEIGHTS:
            card = read_card(out / f"{model}{suffix}")
            assert {"steps": card.steps, **card.metrics} == row
        with safe_open(out / f"{model}.safetensors", "pt") as file:
            assert file.metadata()["steps"] == str(row["steps"])
    return int(result["best"]["steps"])


def test_the_best_policy_is_of_steps_that_the_run_has(tmp_path):
    """A run is extended, finds a better policy, is killed, and resumed with the steps that it had first."""
    out = tmp_path / "run"
    trained(out, 512)
    trained(out, 1024, killed_at=896)
    assert best_of(out) == 768
    trained(out, 512)
    with (out / "evaluations.csv").open() as file:
        returns = {int(row["steps"]): float(row["return"]) for row in csv.DictReader(file)}
    assert returns[best_of(out)] == max(returns.values())


def test_a_better_policy_after_the_checkpoint_is_gone_where_it_does_not_come_again(tmp_path, monkeypatch):
    """As where another machine resumes, and computes otherwise."""
    out = tmp_path / "run"
    trained(out, 1024, killed_at=896)
    assert best_of(out) == 768
    monkeypatch.setattr(Evaluation, "better_than", lambda *_: False)
    trained(out, 640)
    assert best_of(out) < 512


def test_a_checkpoint_without_files_of_the_best_policy_is_resumed(tmp_path):
    """As those of dohyo 0.2.0."""
    out = tmp_path / "run"
    trained(out, 1024, killed_at=896)
    (checkpoint,) = out.glob("checkpoint-*.pt")
    state = torch.load(checkpoint, weights_only=True)
    del state["best_files"]
    torch.save(state, checkpoint)
    trained(out, 640)
    assert best_of(out) in (512, 640)
