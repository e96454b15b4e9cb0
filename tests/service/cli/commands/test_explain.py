from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import agent_info, make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.records.store import write_record
from dohyo.service.cli.main import app
from dohyo.sumo_networks.errors import InvalidInputError

SETTINGS = {"predictor": "constant_velocity", "simulations": 32}


def driven(folder: Path, name: str, settings: dict[str, Any], seconds: float) -> Path:
    """Record of an agent's first seconds."""
    scenario = load_benchmark("quickstart").scenarios([0])[0].model_copy(update={"time_limit_s": seconds})
    entry, mission = resolve(name), scenario.missions[0].name
    agent = make_agent(entry, settings)
    infos = {mission: agent_info(agent, entry, settings)}
    record, trajectory = drive_episode(scenario, {mission: agent}, infos=infos)
    return write_record(folder, "short", record, trajectory)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds of mbappe."""
    return driven(tmp_path_factory.mktemp("records"), "mbappe", SETTINGS, 3.0)


def test_the_tree_of_a_moment_as_json(record: Path) -> None:
    result = CliRunner().invoke(app, ["explain", str(record), "--time", "1.5"])
    assert result.exit_code == 0, result.output
    why = json.loads(result.output)
    assert why["root"]["n"] == 32
    assert why["plan"]
    again = CliRunner().invoke(app, ["explain", str(record), "--time", "1.5"])
    assert json.loads(again.output) == why


def test_and_as_a_picture(record: Path, tmp_path: Path) -> None:
    page = tmp_path / "tree.html"
    result = CliRunner().invoke(app, ["explain", str(record), "--time", "1.5", "--out", str(page)])
    assert result.exit_code == 0, result.output
    assert "32 simulations" in page.read_text()


def test_an_agent_without_a_search_is_refused_by_its_name(tmp_path: Path) -> None:
    record, page = driven(tmp_path, "autopilot", {}, 0.5), tmp_path / "tree.html"
    result = CliRunner().invoke(app, ["explain", str(record), "--time", "0.3", "--out", str(page)])
    assert isinstance(result.exception, InvalidInputError)
    assert "agent 'autopilot' has no search to draw; leave out --out" in str(result.exception)
    assert not page.exists()


def test_arrays_and_infinity_become_plain_json(tmp_path: Path) -> None:
    record = driven(tmp_path, "tests.evaluation.agents:Explains", {}, 0.5)
    result = CliRunner().invoke(app, ["explain", str(record), "--time", "0.3", "--trust"])
    assert result.exit_code == 0, result.output
    why = json.loads(result.stdout, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert why == {"trajectory": [[0.0, 0.0]] * 3, "leader": None, "seed": 0}


def test_a_moment_after_the_end_is_refused(record: Path) -> None:
    result = CliRunner().invoke(app, ["explain", str(record), "--time", "60"])
    assert isinstance(result.exception, InvalidInputError)
    assert "ends at" in str(result.exception)


def test_an_ego_that_is_not_there_is_refused(record: Path) -> None:
    result = CliRunner().invoke(app, ["explain", str(record), "--time", "1", "--ego", "nobody"])
    assert isinstance(result.exception, InvalidInputError)
    assert "nobody" in str(result.exception)
