"""`dohyo dataset semantic` and `dohyo train semantic`."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from dohyo.agents.hierarchical.vision import recording
from dohyo.agents.hierarchical.vision.latents import Encoder
from dohyo.service.cli import main
from tests.agents.hierarchical.vision.weights import picture, pictures


def dohyo(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["dohyo", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_pictures_are_taken_and_an_encoder_is_trained_of_them(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setattr(recording, "record_episode", lambda scenario, order: pictures(4, scenario.seed % 100))
    data, out = str(tmp_path / "data"), str(tmp_path / "run")
    assert dohyo(monkeypatch, "dataset", "semantic", "--out", data, "--images", "8") == 0
    assert "12 pictures" in capsys.readouterr().out
    assert dohyo(monkeypatch, "dataset", "semantic", "--out", data, "--images", "8", "--seed", "1") == 2
    assert "expected a dataset made with" in capsys.readouterr().err
    order = ("train", "semantic", "--set", f"data={data}", "--set", "epochs=1", "--set", "batch=2", "--out", out)
    assert dohyo(monkeypatch, *order) == 0
    assert "semantic.safetensors" in capsys.readouterr().out
    assert Encoder(tmp_path / "run" / "semantic.safetensors").latent(picture(0)).shape == (400,)
    assert dohyo(monkeypatch, *order) == 2
    assert "--resume" in capsys.readouterr().err
    assert dohyo(monkeypatch, *order, "--set", "batch=1", "--resume") == 2
    assert "batch = 2, not 1" in capsys.readouterr().err
