"""The tutorial of a city: its commands, one after the other, on a small city of streets at right angles."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from dohyo.service.cli import app
from tests.extracts import grid

TUTORIAL = Path(__file__).parents[1] / "docs" / "engineers" / "city.md"
LESS = {"evaluate": ["--sample", "1", "--seeds", "0", "--workers", "1"]}
"""Options that make a command drive less."""
ELSEWHERE = ["dohyo demo CITY.osm"]
"""Commands that `tests/service/cli/commands/test_create.py` runs."""


def blocks(language: str) -> list[str]:
    found = re.findall(r"^```(\w*)\n(.*?)^```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    return [block for its_language, block in found if its_language == language]


def commands() -> list[str]:
    lines = [line for block in blocks("") for line in block.splitlines()]
    assert all(line.startswith("dohyo ") for line in lines)
    return lines


def test_every_command_of_the_tutorial_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    Path("CITY.osm").write_text(grid())
    outputs = {}
    for command in commands():
        if command not in ELSEWHERE:
            words = shlex.split(command)[1:]
            done = CliRunner().invoke(app, [*words, *LESS.get(words[0], [])], catch_exceptions=False)
            assert done.exit_code == 0, (command, done.output)
            outputs[words[-1] if words[0] == "networks" else words[0]] = done.output
    assert "carries about" in outputs["--traffic"]
    assert "25 missions of 3" in outputs["benchmarks"]
    assert list(Path("out").glob("*/*/records/*.json"))
    assert "const LANES" in Path("city.html").read_text()


def test_the_tutorial_shows_what_its_command_prints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    (command,) = [line for line in commands() if line.startswith("dohyo benchmarks create")]
    words = shlex.split(command.replace("--network city", "--network ingolstadt"))[1:]
    done = CliRunner().invoke(app, words, catch_exceptions=False)
    (shown,) = blocks("text")
    assert done.output.split() == shown.replace("/home/me", str(tmp_path)).split()
