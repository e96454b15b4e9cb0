"""Runs: what their folder holds, and what is refused."""

from __future__ import annotations

import csv
import json
import shutil
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import onnxruntime
import pytest
from safetensors import safe_open
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from dohyo.agents import trainers
from dohyo.agents.learning.files.card import read_card
from dohyo.agents.learning.files.metrics import Table
from dohyo.agents.learning.files.report import Report, no_report
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.networks.policy import Actor
from dohyo.agents.learning.runs.config import RunConfig
from dohyo.agents.learning.runs.evaluation import Evaluation, Outcome
from dohyo.agents.learning.runs.run import Run, RunStoppedError, Stop
from dohyo.agents.learning.runs.trainer import TrainRequest, train_to_the_end
from dohyo.agents.learning.runs.training import train_task
from dohyo.service.cli import main
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import staged
from tests.agents.learning.killed import different
from tests.agents.learning.problems import Point
from tests.agents.learning.toys import POINT, SMALL, PointConfig


class Alone(Point):
    """A point that needs a process for itself."""

    alone = True


TOY = "tests.agents.learning.toys:POINT"


def dohyo(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["dohyo", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run by the command, with everything that it leaves."""
    out = tmp_path_factory.mktemp("runs") / "point"
    with pytest.MonkeyPatch.context() as patch:
        settings = ("--set", "tensorboard=true", "--set", "checkpoint_every=128", "--set", "seed=5")
        assert dohyo(patch, "train", TOY, "--out", str(out), *settings) == 0
    return out


def test_the_folder_holds_what_was_asked_and_where_it_ran(folder):
    config = read_settings(PointConfig, folder / "config.toml")
    assert config == PointConfig(seed=5, tensorboard=True, checkpoint_every=128)
    document = json.loads((folder / "run.json").read_text())
    (session,) = document["sessions"]
    assert (document["trainer"], document["seed"], session["from_steps"], session["device"]) == (TOY, 5, 0, "cpu")
    assert len(session["commit"]) == 40
    assert session["versions"]["torch"].startswith("2.")


def test_rounds_and_evaluations_have_rows(folder):
    metrics, evaluations = rows(folder / "metrics.csv"), rows(folder / "evaluations.csv")
    assert [int(row["steps"]) for row in metrics] == list(range(128, 1025, 128))
    assert [int(row["steps"]) for row in evaluations] == [0, 512, 1024]
    assert [int(row["steps"]) for row in rows(folder / "timing.csv")] == list(range(128, 1025, 128))
    assert all(float(row["return_low"]) <= float(row["return"]) <= float(row["return_high"]) for row in evaluations)
    assert [int(row["updates"]) for row in evaluations] == [0, 4 * 12, 8 * 12]


def test_checkpoints_are_the_newest_two(folder):
    assert sorted(path.name for path in folder.glob("checkpoint*")) == [
        "checkpoint-000000000896.pt",
        "checkpoint-000000001024.pt",
    ]
    assert not list(folder.glob(".*.tmp"))


def test_what_a_killed_session_had_begun_to_write_is_gone_in_every_folder(folder, tmp_path, monkeypatch):
    out = tmp_path / "again"
    shutil.copytree(folder, out)
    (episodes := out / "demonstrations" / "episodes").mkdir(parents=True)
    scraps = [begun(out / "policy.onnx"), begun(episodes / "0000.npz")]
    others = [out / ".notes.tmp", episodes / ".draft.2.tmp"]
    for path in (*scraps, *others):
        path.write_bytes(b"half")
    assert dohyo(monkeypatch, "train", TOY, "--out", str(out), "--resume") == 0
    assert not any(scrap.exists() for scrap in scraps)
    assert all(other.exists() for other in others), "files that no writer of dohyo has begun"


def begun(path: Path) -> Path:
    """Name under which a file is written first."""
    with suppress(OSError), staged(path) as draft:
        pass
    return draft


def test_events_tell_what_the_rows_tell(folder):
    events = EventAccumulator(str(folder / "tensorboard"))
    events.Reload()
    told = [(event.step, pytest.approx(event.value, rel=1e-6)) for event in events.Scalars("evaluations/return")]
    assert told == [(int(row["steps"]), float(row["return"])) for row in rows(folder / "evaluations.csv")]


def test_results_carry_steps_updates_seed_device_and_tier(folder):
    result = json.loads((folder / "result.json").read_text())
    expected = {"steps": 1024, "updates": 96, "seed": 5, "device": "cpu", "tier": 3, "task": "point", "finished": True}
    assert expected.items() <= result.items()
    assert result["best"]["return"] == max(float(row["return"]) for row in rows(folder / "evaluations.csv"))
    with safe_open(folder / "policy.safetensors", "pt") as file:
        told = file.metadata()
    expected = {"steps": "1024", "updates": "96", "seed": "5", "device": "cpu", "tier": "3", "task": "point"}
    assert expected.items() <= told.items()


def test_the_best_actor_acts_as_it_was_evaluated(folder):
    for name in ("best.safetensors", "best.onnx", "policy.safetensors", "policy.onnx"):
        assert read_card(folder / name).trainer == TOY
    actor = Actor.load(folder / "best.safetensors")
    session = onnxruntime.InferenceSession(folder / "best.onnx")
    returns = []
    for seed in Point().held_out:
        env = Point().make_env(0)
        (observation, _), total, over = env.reset(seed=seed), 0.0, False
        while not over:
            (action,) = session.run(None, {"observation": observation[None]})
            assert action[0] == pytest.approx(actor.act(observation), abs=1e-5)
            observation, reward, terminated, truncated, _ = env.step(actor.act(observation))
            total, over = total + float(reward), terminated or truncated
        returns.append(total)
    best = json.loads((folder / "result.json").read_text())["best"]
    assert sum(returns) / len(returns) == pytest.approx(best["return"])


def test_a_run_can_go_on_further(folder, monkeypatch, capsys):
    before = (folder / "metrics.csv").read_text()
    assert dohyo(monkeypatch, "train", TOY, "--out", str(folder), "--resume", "--set", "steps=1152") == 0
    after = (folder / "metrics.csv").read_text()
    assert after.startswith(before)
    assert after.count("\n") == before.count("\n") + 1
    sessions = json.loads((folder / "run.json").read_text())["sessions"]
    assert [session["from_steps"] for session in sessions] == [0, 1024]


def test_a_resumed_run_is_not_said_to_have_taken_fewer_steps(tmp_path, monkeypatch, capsys):
    out = tmp_path / "run"
    order = ("train", TOY, "--out", str(out), "--set", "ppo.horizon=64")
    assert dohyo(monkeypatch, *order, "--set", "steps=100") == 0
    assert json.loads((out / "result.json").read_text())["steps"] == 128
    assert dohyo(monkeypatch, *order, "--resume", "--set", "steps=100") == 0
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    capsys.readouterr()
    assert dohyo(monkeypatch, *order, "--resume", "--set", "steps=99") == 2
    said = f"dohyo: the run in '{out}' has taken 128 steps: expected steps of at least 128, got 99\n"
    assert capsys.readouterr().err == said
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


def test_a_study_takes_a_finished_run_only_for_what_it_is(folder, tmp_path):
    out = tmp_path / "arm"
    shutil.copytree(folder, out)
    config = read_settings(PointConfig, out / "config.toml")
    before = (out / "metrics.csv").read_bytes()
    train_to_the_end(POINT, TOY, config, out)
    assert (out / "metrics.csv").read_bytes() == before
    with pytest.raises(InvalidInputError, match="was started with seed = 5, not 6"):
        train_to_the_end(POINT, TOY, config.model_copy(update={"seed": 6}), out)
    with pytest.raises(InvalidInputError, match="not of 'another'"):
        train_to_the_end(POINT, "another", config, out)
    with pytest.raises(InvalidInputError, match=f"was started with steps = {config.steps}, not 512"):
        train_to_the_end(POINT, TOY, config.model_copy(update={"steps": 512}), out)
    assert (out / "metrics.csv").read_bytes() == before
    longer = config.model_copy(update={"steps": config.steps + 128})
    ended = (out / "result.json").read_bytes()
    train_to_the_end(POINT, TOY, longer, out)
    assert (out / "metrics.csv").read_bytes().count(b"\n") == before.count(b"\n") + 1
    # As if the longer one had been killed before its first evaluation.
    (out / "result.json").write_bytes(ended)
    train_to_the_end(POINT, TOY, longer, out)
    assert json.loads((out / "result.json").read_text())["steps"] == longer.steps


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "holds a run; continue with --resume, or choose another --out"),
        (("--resume", "--set", "ppo.clip=0.1"), "was started with ppo.clip = 0.2, not 0.1"),
        (("--resume", "--set", "seed=6", "--set", "ppo.hidden=[3]"), "seed = 5, not 6; ppo.hidden = [32, 32], not [3]"),
        (("--resume", "--set", "sed=6"), "unknown key 'sed'; did you mean 'seed'?"),
    ],
)
def test_what_does_not_fit_the_run_is_refused(arguments, message, folder, monkeypatch, capsys):
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert dohyo(monkeypatch, "train", TOY, "--out", str(folder), *arguments) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("predictr",), "no trainer named 'predictr'; did you mean 'predictor'?"),
        (("tests.agents.learning.toys:NONE",), "has no 'NONE'"),
        (("nowhere.at.all:X",), "No module named 'nowhere'"),
        (("tests.agents.learning.toys:SMALL",), "expected a Trainer, got PpoConfig"),
        ((TOY, "--resume"), "no run in"),
        ((TOY, "--set", "device=cuda:77"), "device 'cuda:77' cannot be used"),
        ((TOY, "--set", "steps=x"), "steps: Input should be a valid integer"),
    ],
)
def test_mistakes_are_told_in_one_line_and_leave_nothing(arguments, message, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    assert dohyo(monkeypatch, "train", *arguments, "--out", str(out)) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not out.exists()


def test_a_run_of_another_trainer_is_refused(folder, monkeypatch, capsys):
    other = "tests.agents.learning.toys:LOCK"
    assert dohyo(monkeypatch, "train", other, "--out", str(folder), "--resume") == 2
    assert f"is of '{TOY}', not of '{other}'" in capsys.readouterr().err


def test_one_process_trains_at_a_time(tmp_path):
    run = Run("toy", tmp_path, RunConfig(tensorboard=False))
    with pytest.raises(InvalidInputError, match="is in use by another process"):
        Run("toy", tmp_path, RunConfig(tensorboard=False))
    run.add_table("metrics", ())
    with pytest.raises(InvalidInputError, match="is in use by another process"):
        Run("toy", tmp_path, RunConfig(tensorboard=False), resume=True)
    run.close()
    Run("toy", tmp_path, RunConfig(tensorboard=False), resume=True).close()


def test_what_cannot_be_trained_leaves_no_run_behind(tmp_path):
    def refused(collector, run):
        raise InvalidInputError("no such thing")

    settings = RunConfig(tensorboard=False, processes=0, device="cpu")
    for _ in range(2):
        with pytest.raises(InvalidInputError, match="no such thing"):
            train_task(refused, Point(), settings, TrainRequest("toy", tmp_path, False, no_report))
    assert not (tmp_path / "config.toml").exists()


@pytest.mark.parametrize("measures", [("return",), ("steps",), ("distance", "distance")])
def test_a_measure_with_the_name_of_a_column_is_refused(measures, tmp_path):
    """It would stand where the return does, and choose the best policy."""

    class Misnamed(Point):
        pass

    Misnamed.measures = measures
    settings = RunConfig(tensorboard=False, processes=0, device="cpu")
    with pytest.raises(InvalidInputError, match=rf"measures with names of their own, got {measures[0]}"):
        train_task(lambda collector, run: None, Misnamed(), settings, TrainRequest("toy", tmp_path, False, no_report))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("processes", "environments", "fits"), [(0, 2, False), (0, 1, True), (1, 2, True)])
def test_a_task_that_needs_a_process_for_each_environment_has_one(processes, environments, fits, tmp_path):
    def made(collector, run):
        raise RuntimeError("made")

    settings = RunConfig(tensorboard=False, processes=processes, environments=environments, device="cpu")
    refused = (InvalidInputError, "'point': a process can hold only one .* at least 1 for environments = 2, got 0")
    error, message = (RuntimeError, "made") if fits else refused
    with pytest.raises(error, match=message):
        train_task(made, Alone(), settings, TrainRequest("toy", tmp_path / "run", False, no_report))
    assert (tmp_path / "run").exists() == fits


def test_a_trainer_of_ones_own_is_found_where_the_command_runs(tmp_path, monkeypatch, capsys):
    (tmp_path / "own_trainer.py").write_text("from tests.agents.learning.toys import LOCK as OWN")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    assert dohyo(monkeypatch, "train", "own_trainer:OWN", "--set", "steps=128") == 0
    assert (tmp_path / "runs" / "own" / "best.safetensors").exists()


def test_every_registered_trainer_is_where_the_list_says_and_says_the_same():
    for name, listed in trainers.TRAINERS.items():
        assert trainers.trainer_named(name).summary == listed.summary


def test_rows_beyond_the_checkpoint_are_dropped_and_a_torn_one_too(tmp_path):
    path = tmp_path / "t.csv"
    table = Table(path, ("a", "b"), keep=None)
    for steps in (1, 2, 3):
        table.add(steps, {"a": 0.1 + 0.2})
    table.close()
    whole = path.read_text()
    path.write_text(whole + "4,0.3")
    Table(path, ("a", "b"), keep=2).close()
    assert path.read_text() == "steps,a,b\n1,0.30000000000000004,\n2,0.30000000000000004,\n"
    with pytest.raises(InvalidInputError, match="expected columns steps, a, c, got steps, a, b"):
        Table(path, ("a", "c"), keep=2)
    with pytest.raises(KeyError, match="has no column z"):
        Table(path, ("a", "b"), keep=2).add(3, {"z": 1})


def test_a_stop_is_heard_and_the_handlers_are_put_back():
    before = signal.getsignal(signal.SIGTERM)
    with Stop().listening() as stop:
        assert not stop.requested
        signal.raise_signal(signal.SIGTERM)
        patience = time.monotonic() + 60
        while not stop.requested and time.monotonic() < patience:
            time.sleep(0.001)
        assert stop.requested
    assert signal.getsignal(signal.SIGTERM) is before


def test_an_interrupted_run_goes_on_as_if_nothing_had_been(tmp_path):
    """Stopped between two checkpoints, and at one before its evaluation: the rows are those of a whole run."""

    def stop_at(steps: int) -> Callable[[Report], None]:
        return lambda report: signal.raise_signal(signal.SIGINT) if report.steps == steps else None

    config = PointConfig(steps=640, evaluate_every=512, ppo=SMALL.model_copy(update={"guided_share": 0.5}))
    whole, out = tmp_path / "whole", tmp_path / "disturbed"
    POINT.train(config, TrainRequest("point", whole, False, no_report))
    for steps, kept, resume in ((384, 256, False), (512, 512, True)):
        message = f"stopped at step {steps}; it will go on from the checkpoint of step {kept}"
        with pytest.raises(RunStoppedError, match=message):
            POINT.train(config, TrainRequest("point", out, resume, stop_at(steps)))
        assert [int(row["steps"]) for row in rows(out / "evaluations.csv")] == [0]
    POINT.train(config, TrainRequest("point", out, True, no_report))
    assert [int(row["steps"]) for row in rows(out / "evaluations.csv")] == [0, 512, 640]
    assert different(whole, out) == []


def test_the_best_policy_is_that_of_the_highest_return_or_of_the_most_successes():
    def told(total: float, successes: int) -> Evaluation:
        return Evaluation([Outcome(seed, total, 10, seed < successes, {}) for seed in range(10)])

    stands, arrives, both = told(500.0, 0), told(400.0, 6), told(450.0, 6)
    assert stands.better_than(arrives.values(), "return")
    assert not stands.better_than(arrives.values(), "success")
    assert both.better_than(arrives.values(), "success")
    assert not arrives.better_than(both.values(), "success")
    assert not both.better_than(both.values(), "return")
