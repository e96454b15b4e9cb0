"""`dohyo dataset affordances` and `dohyo train affordances`."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from dohyo.agents.gri.vision import recording
from dohyo.agents.gri.vision.frozen import SHAPE, FrozenEncoder
from dohyo.service.cli import main
from tests.agents.gri.vision.data import moments


def dohyo(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["dohyo", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_drives_are_recorded_and_an_encoder_is_trained_of_them(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setattr(recording, "recorded", lambda scenario, order: {"ego": (moments(8, scenario.seed % 97), {})})
    data, out = str(tmp_path / "data"), tmp_path / "run"
    assert dohyo(monkeypatch, "dataset", "affordances", "--out", data, "--moments", "1") == 0
    assert "48 moments" in capsys.readouterr().out
    order = ("train", "affordances", "--set", f"data={data}", "--set", "epochs=1", "--set", "batch=4")
    assert dohyo(monkeypatch, *order, "--out", str(out)) == 0
    assert "affordances.onnx" in capsys.readouterr().out
    assert FrozenEncoder(out / "affordances.onnx").features(moments(1, 0)["pictures"][0]).any()
    assert moments(1, 0)["pictures"][0].shape == SHAPE
