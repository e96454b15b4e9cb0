"""`dohyo dataset motion` and `dohyo train predictor`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from dohyo.agents.mcts.predictors.dataset import Shard
from dohyo.agents.mcts.predictors.learned import Learned
from dohyo.agents.trainers import TRAINERS
from dohyo.service.cli import main
from tests.agents.mcts.predictors.scenes import busy, sampled


def dohyo(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["dohyo", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_a_predictor_is_trained_exported_and_usable(tmp_path: Path, monkeypatch, capsys):
    for split in ("train", "validation"):
        (tmp_path / split).mkdir()
        shard = Shard.of([sampled(busy(seed, actors=3, lanes=2)) for seed in range(4)])
        (tmp_path / split / "a.npz").write_bytes(shard.to_bytes())
    config = tmp_path / "c.toml"
    config.write_text(f'data = "{tmp_path}"\nsteps = 2\nbatch = 2\n')
    order = ("train", "predictor", "--config", str(config), "--out", str(tmp_path / "out"))
    assert dohyo(monkeypatch, *order) == 0
    shown = capsys.readouterr()
    assert "predictor.onnx" in shown.out
    assert "predictor: 2 of 2 steps" in shown.err
    assert Learned(tmp_path / "out" / "predictor.onnx").predict(busy(0)).ego is not None
    assert dohyo(monkeypatch, *order) == 2
    assert "--resume" in capsys.readouterr().err
    assert dohyo(monkeypatch, *order, "--resume") == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["dataset", "motion", "--networks", "town-trian", "--out", "OUT"], "did you mean 'town-train'"),
        (["dataset", "motion", "--networks", " , ", "--out", "OUT"], "expected networks"),
        (["train", "predictor", "--config", "OUT/none.toml"], "cannot read"),
    ],
)
def test_mistakes_are_told_in_one_line_and_leave_nothing(arguments, message, tmp_path: Path, monkeypatch, capsys):
    out = tmp_path / "out"
    assert dohyo(monkeypatch, *[argument.replace("OUT", str(out)) for argument in arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.startswith("dohyo: ")
    assert error.count("\n") == 1
    assert not out.exists()


def test_the_list_names_every_trainer_with_its_files(monkeypatch, capsys):
    assert dohyo(monkeypatch, "train", "--list", "--json") == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows.keys() == TRAINERS.keys()
    assert rows["value"]["writes"] == "value.safetensors"
    assert dohyo(monkeypatch, "train", "--list") == 0
    assert "module:ATTRIBUTE" in capsys.readouterr().out


def test_a_training_without_a_name_is_refused(monkeypatch, capsys):
    assert dohyo(monkeypatch, "train") == 2
    assert "dohyo train --list" in capsys.readouterr().err
