"""The tutorials of a car's log and of detectors: their commands, one after the other, on the data that they make."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from dohyo.agents.localization.settings import Settings
from dohyo.service.cli import app

TUTORIALS = Path(__file__).parents[1] / "docs" / "engineers"
ELSEWHERE = ["dohyo localize --study --seeds 1"]
"""Commands that `tests/agents/localization/study/test_grid.py` runs."""


def blocks(name: str) -> list[tuple[str, str]]:
    """Language and text of each block."""
    text = (TUTORIALS / f"{name}.md").read_text(encoding="utf-8")
    return re.findall(r"^```(\w*)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def follow(name: str) -> str:
    """Runs a tutorial's commands; their output."""
    out = []
    for language, block in blocks(name):
        if language == "python":
            exec(block, {})
        for command in block.splitlines() if not language else []:
            if command not in ELSEWHERE:
                # Figures need a browser, which takes seconds.
                words = shlex.split(re.sub(r" --figure \S+", "", command))
                assert words[0] == "dohyo"
                done = CliRunner().invoke(app, words[1:], catch_exceptions=False)
                assert done.exit_code == 0, (command, done.output)
                out.append(done.output)
    return "\n".join(out)


def test_the_log_of_a_car_gives_its_track(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    printed = follow("localization")
    shown = next(block for language, block in blocks("localization") if language == "text")
    for line in shown.splitlines()[1:]:
        name, *values = re.split(r"\s{2,}", line.strip())
        assert re.search(re.escape(name) + r"\s+" + r"\s+".join(map(re.escape, values)), printed), line
    assert "WARNING" not in printed
    assert Path("track.csv").read_text().startswith("t,x,y,heading,sigma_x,sigma_y\n")


def test_the_settings_of_the_tutorial_are_settings() -> None:
    (text,) = (block for language, block in blocks("localization") if language == "toml")
    settings = Settings.model_validate(tomllib.loads(text))
    assert settings.noise == Settings().noise
    assert settings.car.level_rad == Settings().car.level_rad


def test_tables_of_detectors_give_the_next_minutes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    printed = follow("forecasting")
    assert "2 files joined by time" in printed
    assert re.search(r"upstream\s+\d+\S* +\d+\S* \[", printed)
    assert len(Path("forecasts.csv").read_text().splitlines()) == 1 + 2 * 3
