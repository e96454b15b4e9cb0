"""Mixed runs on the command line: each ego its own agent, records and scores by agent."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dohyo.evaluation.records.store import read_record
from dohyo.evaluation.running.run import read_result
from dohyo.service.cli import main
from dohyo.service.cli.commands.remote import parse_egos
from dohyo.sumo_networks.errors import InvalidInputError

STEADY = "tests.evaluation.agents:Steady"
TOGETHER = """
name = "two"
description = "for tests"
headline = "driving_score"
metric = "driving score"
seeds = [0]

[[cells]]
name = "street"
network = "ingolstadt"
missions = "both"
together = true
traffic = { warm_up_s = 0.0 }

[[missions.both]]
name = "front"
start = { lane = "737320747#3_2", position_m = 20.0 }
goal = { lane = "737320747#4_2", position_m = 20.0 }

[[missions.both]]
name = "back"
start = { lane = "737320747#3_2", position_m = 5.0 }
goal = { lane = "737320747#4_2", position_m = 10.0 }
"""

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Call:
    """Calls a command in this process, in an empty folder with the benchmark."""
    (tmp_path / "two.toml").write_text(TOGETHER)
    monkeypatch.chdir(tmp_path)

    def made(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["dohyo", *arguments])
        monkeypatch.setattr(sys, "path", list(sys.path))
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return int(ended.value.code or 0), printed.out, printed.err

    return made


def evaluate(call: Call, *agents: str, out: str) -> Any:
    options = [word for agent in agents for word in ("--agent", agent)]
    code, printed, errors = call("evaluate", *options, "--benchmark", "two.toml", "--out", out, "--json")
    assert code == 0, errors
    return json.loads(printed)


def test_each_ego_has_its_agent_in_record_scores_and_report(call: Call) -> None:
    here = evaluate(call, f"front={STEADY}", "back=autopilot", out="here")
    assert [(one["ego"], one["agent"]) for one in here["drives"]] == [("front", "steady"), ("back", "autopilot")]
    assert [one["agent"] for one in here["agents"]] == ["steady", "autopilot"]
    assert [(one["agents"], one["episodes"]) for one in here["meetings"]] == [(["steady", "autopilot"], 1)]
    record = here["drives"][0]["record"]
    assert [ego.agent.name for ego in read_record(Path(record)).egos] == ["steady", "autopilot"]
    code, printed, _ = call("verify", record, "--trust", "--json")
    assert (code, json.loads(printed)["same"]) == (0, True)
    code, printed, _ = call("score", record, "--json")
    assert [one["scores"] for one in json.loads(printed)["agents"]] == [one["scores"] for one in here["agents"]]

    evaluate(call, "autopilot", f"back={STEADY}", out="exchanged")
    code, printed, errors = call("report", "here", "exchanged", "--out", "report.html")
    assert code == 0, errors
    assert "on 2 common drives in 1 episode, too few to decide" in printed
    assert "agents that met" in printed
    assert "autopilot" in Path("report.html").read_text()


def test_a_mix_of_one_agent_is_the_run_of_that_agent(call: Call) -> None:
    alone = evaluate(call, STEADY, out="alone")
    again = evaluate(call, f"front={STEADY}", f"back={STEADY}", out="alone")
    assert again["drives"] == alone["drives"]
    assert read_result(Path("alone")).manifest.others == {}
    assert "others" not in json.loads(Path("alone/evaluation.json").read_text())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--agent", "front=autopilot"], "got none for back"),
        (["--agent", "autopilot", "--agent", "middle=autopilot"], "agent of 'middle': expected a mission"),
        (["--agent", "front=autopilot", "--agent", "front=idm"], "expected one agent for mission 'front', got two"),
        (["--agent", "autopilot", "--agent", "idm"], "expected one agent without a mission, got two"),
        (["--agent", "=autopilot"], "expected AGENT or MISSION=AGENT"),
        (["--agent", "autopilot", "--agent", f"back={STEADY}", "--set", "after=3"], "--set: expected one --agent"),
    ],
)
def test_a_mix_that_cannot_be_is_one_line(options: list[str], words: str, call: Call) -> None:
    code, _, errors = call("evaluate", *options, "--benchmark", "two.toml", "--out", "none")
    assert code == 2
    assert words in " ".join(errors.split())
    assert not Path("none").exists()


def test_the_agents_of_a_mixed_run_at_a_service_are_options() -> None:
    assert parse_egos(["front=mbappe", "back=ghrl@2"]) == {
        "front": {"agent": "mbappe"},
        "back": {"agent": "ghrl", "version": 2},
    }


@pytest.mark.parametrize("options", [["front"], ["=idm"], ["front="], ["front=idm@"], ["front=idm@x"], ["a=b", "a=c"]])
def test_an_option_of_another_form_is_one_line(options: list[str]) -> None:
    with pytest.raises(InvalidInputError, match=r"--ego '.*': expected"):
        parse_egos(options)
