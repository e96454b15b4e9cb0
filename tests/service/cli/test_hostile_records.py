"""Records of strangers against the commands that read them: none may choose which code runs or which file is read."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from dohyo.agents.registry import SHIELDED
from dohyo.evaluation.agent import agent_info, make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import versions
from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord
from dohyo.evaluation.records.store import read_record, seal, write_record
from dohyo.evaluation.running.manifest import manifest_of
from dohyo.service.cli.commands.records import verify
from dohyo.service.episodes.recorded_agents import UntrustedRecordError, build_agents, check_known
from dohyo.service.policies.agent import ENTRY as POLICY
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.scenario import Scenario, Traffic, content_hash
from tests.evaluation.builders import drive, ego, episode
from tests.forked import MAIN, Python

ROOT = Path(__file__).parents[3]
AUTOPILOT = "dohyo.agents.experts.autopilot:Autopilot"
COMMANDS = (("verify",), ("explain", "--time", "1"))


def record_of(agent: AgentInfo, network: str = "ingolstadt") -> EpisodeRecord:
    """A record as a stranger may make it: right hash, right versions, any agent."""
    scenario = load_benchmark("quickstart").scenarios([0])[0].model_copy(update={"network": network})
    made = episode(ego(agent=agent, name=scenario.missions[0].name))
    return seal(made.model_copy(update={"scenario": scenario, "versions": versions(load_network("ingolstadt"))}))


def info(entry: str, **fields: Any) -> AgentInfo:
    given = {"name": "x", "kind": "builtin", "track": "map", "sensors": (), "control": "pedals_steering"} | fields
    return AgentInfo(entry=entry, **given)


def dohyo(*arguments: str, cwd: Path) -> Python:
    """A command that has ended; its modules are not those of its working directory, as an installed one's."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = Python(f"import sys; sys.path.remove(''); {MAIN}", *arguments, cwd=cwd, env=environment)
    process.end()
    return process


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
def test_a_record_runs_no_program(command: tuple[str, ...], tmp_path: Path) -> None:
    """`subprocess:Popen` with arguments of the record's author."""
    marker = tmp_path / "ran"
    agent = info("subprocess:Popen", settings={"args": ["touch", str(marker)]})
    record = write_record(tmp_path, "one", record_of(agent), drive())
    result = dohyo(command[0], str(record), *command[1:], cwd=tmp_path)
    assert result.returncode == 2
    assert "no installed package registers 'subprocess:Popen'" in result.errors()
    assert len(result.errors().strip().splitlines()) == 1
    assert not marker.exists()


def test_with_trust_it_would_run(tmp_path: Path) -> None:
    marker = tmp_path / "ran"
    agent = info("subprocess:Popen", settings={"args": ["touch", str(marker)]})
    record = write_record(tmp_path, "one", record_of(agent), drive())
    assert dohyo("verify", str(record), "--trust", cwd=tmp_path).returncode == 2
    assert marker.exists(), "the attack of the test above is real"


def test_a_module_beside_the_record_is_not_imported(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("open('ran', 'w').close()\nclass Mine: ...\n")
    record = write_record(tmp_path, "one", record_of(info("mine:Mine")), drive())
    assert dohyo("verify", str(record), cwd=tmp_path).returncode == 2
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("agent", "says"),
    [
        (info(SHIELDED, settings={"inner": "subprocess:Popen", "args": ["true"]}), "no installed package registers"),
        (info(SHIELDED, settings={"inner": ["subprocess:Popen"]}), "no installed package registers"),
        (info(AUTOPILOT, source_sha256="0" * 64), "has changed since"),
        (info("remote:x", kind="remote"), "drove through policy workers"),
        (info(POLICY, kind="onnx", settings={"path": "/etc/passwd"}), "has no setting 'path'"),
        (info(POLICY, kind="onnx", settings={"sha256": "../../x"}), "has changed since"),
    ],
)
def test_an_agent_is_checked_before_it_is_built(agent: AgentInfo, says: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def built(*_: Any) -> Any:
        raise AssertionError("it was built")

    monkeypatch.setattr("dohyo.service.episodes.recorded_agents.make_agent", built)
    with pytest.raises(InvalidInputError, match=says):
        build_agents(record_of(agent))


def test_a_setting_may_not_name_a_file(tmp_path: Path) -> None:
    entry = "dohyo.agents.rules.rules_only:RulesOnly"
    there = agent_info(make_agent(entry), entry)
    check_known(there)
    with pytest.raises(UntrustedRecordError, match="setting 'rules' names a file"):
        check_known(there.model_copy(update={"settings": {"rules": str(tmp_path)}}))


def autopilots(scenario: Scenario) -> EpisodeRecord:
    """A record of the autopilot in a scenario that is said to be one of quickstart."""
    agent = agent_info(make_agent(AUTOPILOT), AUTOPILOT, kind="builtin")
    named = ("quickstart", load_benchmark("quickstart").sha256)
    return seal(record_of(agent).model_copy(update={"scenario": scenario, "benchmark": named}))


@pytest.mark.parametrize("folder", [False, True], ids=["alone", "in a result folder"])
def test_an_easier_scenario_is_not_that_of_the_benchmark(folder: bool, tmp_path: Path) -> None:
    """It would drive to the same hash again; whether it is easier, only the benchmark says."""
    benchmark = load_benchmark("quickstart")
    scenario = benchmark.scenarios([0])[0].model_copy(update={"traffic": Traffic(vehicles=0, pedestrians=0)})
    record = autopilots(scenario)
    path = write_record(tmp_path / "records", "one", record, drive())
    if folder:
        manifest = manifest_of({"ego": record.egos[0].agent}, benchmark, benchmark.sha256)
        (tmp_path / "evaluation.json").write_text(manifest.model_dump_json())
    with pytest.raises(InvalidInputError, match=r"one\.json: expected scenario 'through-east' .* with other traffic"):
        verify(path)


def test_a_manifest_may_not_name_a_file_as_network(tmp_path: Path) -> None:
    net = tmp_path / "trap.net.xml"
    os.mkfifo(net)
    plain = load_benchmark("quickstart")
    cells = (*plain.cells, plain.cells[0].model_copy(update={"name": "trap", "network": str(net)}))
    benchmark = plain.model_copy(update={"cells": cells})
    record = autopilots(plain.scenarios([0])[0])
    record = seal(record.model_copy(update={"benchmark": ("quickstart", benchmark.sha256)}))
    path = write_record(tmp_path / "records", "one", record, drive())
    manifest = manifest_of({"ego": record.egos[0].agent}, benchmark, benchmark.sha256)
    (tmp_path / "evaluation.json").write_text(manifest.model_dump_json())
    with pytest.raises(UntrustedRecordError, match=r"trap\.net\.xml' of its benchmark is not in the catalog"):
        verify(path)


def test_every_agent_of_a_mixed_record_is_checked(tmp_path: Path) -> None:
    """Two egos with one entry: the settings of the first must not pass unseen behind those of the second."""
    entry = "dohyo.agents.rules.rules_only:RulesOnly"
    there = agent_info(make_agent(entry), entry)
    plain = record_of(there)
    first = plain.egos[0].model_copy(update={"agent": there.model_copy(update={"settings": {"rules": str(tmp_path)}})})
    second = plain.egos[0].model_copy(update={"name": "other"})
    with pytest.raises(UntrustedRecordError, match="setting 'rules' names a file"):
        build_agents(seal(plain.model_copy(update={"egos": (first, second)})))


def test_a_network_is_a_name_of_the_catalog(tmp_path: Path) -> None:
    net = tmp_path / "trap.net.xml"
    os.mkfifo(net)  # a program that opens it waits for ever
    with pytest.raises(UntrustedRecordError, match="not in the catalog"):
        build_agents(record_of(info(AUTOPILOT), network=str(net)))


def test_a_wrapped_agent_of_the_registry_is_built() -> None:
    entry, settings = SHIELDED, {"inner": "autopilot", "shield": "rss", "localization": "es-ekf"}
    known = agent_info(make_agent(entry, settings), entry, settings, "builtin")
    agents = build_agents(record_of(known.model_copy(update={"name": "my-name-at-the-service"})))
    assert [agent.spec.name for agent in agents.values()] == [known.name]


HOSTILE = {
    "deep": b'{"record_hash":' + b"[" * 200_000,
    "nan": b'{"record_hash":"x","ticks":NaN}',
    "no-object": b"[]",
    "not-text": b'{"record_hash":"x","a":"\\ud800"}\xff',
    "escape": b'{"record_hash":"\\u001b[2J\\nfake line"}',
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    path = tmp_path / "one.json"
    path.write_bytes(HOSTILE[name])
    with pytest.raises(InvalidInputError) as refused:
        read_record(path)
    assert str(refused.value).isprintable()


def test_a_file_without_end_is_refused(tmp_path: Path) -> None:
    (tmp_path / "endless.json").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe.json")
    with (tmp_path / "large.json").open("wb") as file:
        file.truncate(60_000_000)
    for name in ("endless", "pipe", "large"):
        with pytest.raises(InvalidInputError, match="expected an episode record"):
            read_record(tmp_path / f"{name}.json")


def test_what_a_terminal_would_obey_is_not_shown(tmp_path: Path) -> None:
    path = write_record(tmp_path, "one", record_of(info(AUTOPILOT)), drive())
    raw = json.loads(path.read_text())
    raw["egos"][0]["agent"]["name"] = "\x1b[2Jpretty\nsame: 1234"
    outside = ("record_hash", "timing", "parquet_sha256")
    raw["record_hash"] = content_hash({key: value for key, value in raw.items() if key not in outside})
    path.write_text(json.dumps(raw))
    assert read_record(path).egos[0].agent.name == " [2Jpretty same: 1234"
