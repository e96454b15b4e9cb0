"""`dohyo agents list` and `show`, beside agents of other packages, and for a class in the current folder."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import NamedTuple, Protocol

import pytest

from dohyo.agents.registry import agent_entries
from dohyo.service.cli import main
from tests.agents.packages import install_lab


class Printed(NamedTuple):
    code: int
    out: str
    err: str


class Call(Protocol):
    def __call__(self, *words: str) -> Printed: ...


@pytest.fixture
def agents(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    def call(*words: str) -> Printed:
        monkeypatch.setattr(sys, "argv", ["dohyo", "agents", *words])
        monkeypatch.setattr(sys, "path", list(sys.path))
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        return Printed(int(ended.value.code or 0), *capsys.readouterr())

    return call


def test_an_agent_that_cannot_be_described_hides_no_other(
    agents: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dohyos = {*agent_entries()}
    install_lab(tmp_path, monkeypatch)
    listed = agents("list", "--json")
    assert {one["name"] for one in json.loads(listed.out)} == dohyos | {"lab-open"}
    told = listed.err.splitlines()
    assert [line.partition(": agent ")[2].partition(":")[0] for line in told] == [
        "'lab-closed' of package 'old-lab'", "'lab-gone' of package 'old-lab'"
    ]  # fmt: skip
    assert ("'weights': expected text" in told[0], "No module named 'lab_that" in told[1]) == (True, True)
    other = agents("show", "autopilot", "--json")
    assert (json.loads(other.out)["track"], other.err) == ("privileged", "")


def test_the_settings_of_such_an_agent_are_shown(agents: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install_lab(tmp_path, monkeypatch)
    shown = json.loads(agents("show", "lab-closed", "--json").out)
    assert (shown["entry"], shown["settings"]["required"]) == ("lab_of_tests:Closed", ["weights"])
    assert json.loads(agents("show", "lab-open", "--json").out)["sensors"] == ["speedometer"]
    gone = agents("show", "lab-gone")
    assert (gone.code, gone.err.count("\n")) == (2, 1)
    assert gone.err.startswith("dohyo: agent 'lab-gone' of package 'old-lab': ")


def test_a_class_in_the_current_folder_is_found(agents: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "driver_of_here.py").write_text("class Driver:\n    def __init__(self, gain: float = 0.5): ...\n")
    monkeypatch.chdir(tmp_path)
    shown = agents("show", "driver_of_here:Driver")
    assert (shown.code, shown.err) == (0, "")
    assert "gain" in shown.out


def test_a_line_break_in_a_name_makes_no_second_line(agents: Call) -> None:
    shown = agents("show", "nobody\ndohyo: all is well")
    assert (shown.code, len(shown.err.splitlines())) == (2, 1)
