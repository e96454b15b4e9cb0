"""`dohyo report` and `dohyo score` on hand-made episodes of `fleet`, in which eight egos drive at once."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from typer.testing import CliRunner

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.records.store import seal, write_record
from dohyo.evaluation.running.manifest import MANIFEST, RECORDS, manifest_of
from dohyo.service.cli import app
from tests.evaluation.builders import AGENT, drive, ego, episode

FLEET: Benchmark = load_benchmark("fleet")
OTHER = AGENT.model_copy(update={"name": "other"})
dohyo = CliRunner(env={"COLUMNS": "300"})


def driven(folder: Path, others: Mapping[str, AgentInfo], statuses: Mapping[str, Status] | None = None) -> Path:
    """A result folder of one episode; all egos time out, but for those with another status."""
    (scenario,) = FLEET.scenarios([0])
    agents = {one.name: others.get(one.name, AGENT) for one in scenario.missions}
    found = dict.fromkeys(agents, Status.TIMED_OUT) | dict(statuses or {})
    egos = [ego(name=name, agent=agent, status=found[name]) for name, agent in agents.items()]
    made = episode(*egos, benchmark=(FLEET.name, FLEET.sha256)).model_copy(update={"scenario": scenario})
    write_record(folder / RECORDS, f"{scenario.name}-s0", seal(made), drive())
    manifest = manifest_of(agents, FLEET, FLEET.sha256, None, [0])
    (folder / MANIFEST).write_text(manifest.model_dump_json())
    return folder


def record_of(folder: Path) -> str:
    (path,) = (folder / RECORDS).glob("*.json")
    return str(path)


def test_an_agent_that_drives_several_egos_of_a_mixed_run_is_reported_once(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run", {"yard": OTHER, "south": OTHER})
    done = dohyo.invoke(app, ["report", str(folder), "--out", str(tmp_path / "page.html")])
    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[0].split() == ["tester", "other"]
    told = json.loads(dohyo.invoke(app, ["score", record_of(folder), "--json"]).stdout)
    assert [(one["agent"], one["scores"]["success"]["n"]) for one in told["agents"]] == [("tester", 6), ("other", 2)]
    assert [one["agents"] for one in told["meetings"]] == [["tester", "other"]]


def test_a_lost_episode_has_no_scores_of_its_other_drives(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run", {}, {"yard": Status.GRIDLOCK})
    told = json.loads(dohyo.invoke(app, ["score", record_of(folder), "--json"]).stdout)
    assert (told["lost"], told["drives"]) == (8, [])
    assert "yard" not in dohyo.invoke(app, ["score", record_of(folder)]).output


def test_one_agent_on_several_egos_has_the_summary_of_one_agent(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run", {})
    told = json.loads(dohyo.invoke(app, ["score", record_of(folder), "--json"]).stdout)
    assert (told["agent"], told["scores"]["success"]["n"]) == ("tester", 8)
    assert "meetings" not in told
