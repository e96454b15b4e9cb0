"""The command line as a stranger uses it: exit codes, what is printed and what is written; some in real processes."""

from __future__ import annotations

import gzip
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dohyo.service.cli import main

ROOT = Path(__file__).parents[3]
STEADY = "tests.evaluation.agents:Steady"

SHORT = """
name = "short"
description = "for tests"
headline = "driving_score"
metric = "driving score"
network = "ingolstadt"
traffic = { vehicles = 5, pedestrians = 5, warm_up_s = 5.0 }
seeds = [0, 1]

[[missions]]
name = "along"
start = { lane = "737320747#3_2", position_m = 5.0 }
goal = { lane = "737320747#4_2", position_m = 20.0 }
"""


Call = Callable[..., subprocess.CompletedProcess[str]]


def dohyo(*arguments: str, cwd: Path = ROOT, columns: int = 160) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from dohyo.service.cli import main; main()", *arguments]
    environment = {"PYTHONPATH": str(ROOT), "COLUMNS": str(columns)}

    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=300, env=os.environ | environment, check=False
    )


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Calls a command in this process, which need not import everything again."""

    def call(*arguments: str) -> subprocess.CompletedProcess[str]:
        monkeypatch.setattr(sys, "argv", ["dohyo", *arguments])
        monkeypatch.setattr(sys, "path", list(sys.path))
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return subprocess.CompletedProcess(arguments, int(ended.value.code or 0), printed.out, printed.err)

    return call


def document(result: subprocess.CompletedProcess[str]) -> Any:
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("benchmark") / "short.toml"
    path.write_text(SHORT)
    return path


@pytest.fixture(scope="module")
def evaluated(short: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    out = tmp_path_factory.mktemp("evaluated")
    result = dohyo("evaluate", "--agent", STEADY, "--benchmark", str(short), "--out", str(out), "--json")
    return out, document(result)


def test_lists_name_what_there_is(here: Call) -> None:
    assert {"ingolstadt", "adlershof"} <= {row["name"] for row in document(here("networks", "list", "--json"))}
    assert {"autopilot", "reckless", "random"} <= {row["name"] for row in document(here("agents", "list", "--json"))}
    assert "quickstart" in {row["name"] for row in document(here("benchmarks", "list", "--json"))}


def test_adlershof_has_its_lights_and_crossings(here: Call) -> None:
    (row,) = [row for row in document(here("networks", "list", "--json")) if row["name"] == "adlershof"]
    assert (row["lights"], row["crossings"]) == (21, 503)


def test_evaluate_prints_one_json_document(evaluated: tuple[Path, Any]) -> None:
    out, printed = evaluated
    assert printed["scores"]["success"]["mean"] == 100.0
    assert set(printed["per_km"]) >= {"collision_vehicle", "red_light"}
    assert [(drive["scenario"], drive["seed"]) for drive in printed["drives"]] == [("along", 0), ("along", 1)]
    for drive in printed["drives"]:
        assert json.loads(Path(drive["record"]).read_text())["record_hash"] == drive["record_hash"]
        assert Path(drive["record"]).with_suffix(".parquet").exists()
    assert (out / "evaluation.json").exists()


READS_WEIGHTS = """
from pathlib import Path

import numpy as np

from dohyo.evaluation.agent import Agent, AgentSpec


class Unnamed(Agent):
    spec = AgentSpec(name="unnamed", sensors=("speedometer",), control="lane_command")

    def __init__(self, weights: str = "weights.txt"):
        self.speed = float(Path(weights).read_text())

    def reset(self, mission, seed):
        pass

    def act(self, observation):
        return np.array([self.speed, 0.0])


class Named(Unnamed):
    def __init__(self, weights: str = "weights.txt"):
        super().__init__(weights)
        self.files = (weights,)
"""


def test_evaluate_tells_of_weights_that_records_do_not_name(
    short: Path, tmp_path: Path, here: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "own_weights.py").write_text(READS_WEIGHTS)
    (tmp_path / "weights.txt").write_text("6.0")
    monkeypatch.chdir(tmp_path)
    order = ("--benchmark", str(short), "--seeds", "0", "--workers", "1")
    note = "dohyo: agent 'unnamed': setting 'weights' is a file that its record does not name; list it in `files`"

    unnamed = here("evaluate", "--agent", "own_weights:Unnamed", *order, "--json")
    document(unnamed)
    assert unnamed.stderr.count(note) == 1, "the file is the default"
    wrapped = ("--set", "weights=weights.txt", "--set", "shield=rss", "--only", "nothing")
    assert note in here("evaluate", "--agent", "own_weights:Unnamed", *order, *wrapped).stderr.replace("+rss", "")
    several = here("evaluate", "--agent", "along=own_weights:Unnamed", *order, "--out", "mixed", "--only", "nothing")
    assert note in several.stderr

    named = here("evaluate", "--agent", "own_weights:Named", *order, "--set", "weights=weights.txt", "--out", "named")
    assert (named.returncode, named.stderr) == (0, "")
    (tmp_path / "weights.txt").write_text("7.0")
    again = here("evaluate", "--agent", "own_weights:Named", *order, "--set", "weights=weights.txt", "--out", "named")
    assert (again.returncode, "choose another --out" in again.stderr) == (2, True)


def test_verify_proves_a_record_and_tells_a_changed_world(evaluated: tuple[Path, Any], here: Call) -> None:
    record = evaluated[1]["drives"][0]["record"]
    told = document(here("verify", record, "--trust", "--json"))
    assert (told["same"], told["benchmark"]["name"], told["benchmark"]["compared"]) == (True, "short", True)
    shown = here("verify", record, "--signature-only").stdout
    assert f"benchmark: 'short' '{told['benchmark']['sha256'][:8]}', not compared with it" in shown


def test_verify_has_the_deadline_of_evaluate(short: Path, tmp_path: Path, here: Call) -> None:
    order = ("--agent", "tests.service.cli.late:LateOnce", "--benchmark", str(short), "--seeds", "0")
    here("evaluate", *order, "--out", str(tmp_path), "--deadline", "4", "--workers", "1")
    (record,) = (tmp_path / "records").glob("*.json")
    assert json.loads(record.read_text())["egos"][0]["status"] == "failed: agent did not answer in time"
    again = document(here("verify", str(record), "--trust", "--json", "--deadline", "4"))
    assert (again["same"], again["late"]) == (True, [])
    patient = here("verify", str(record), "--trust")
    assert patient.returncode == 1
    told = "'failed: agent did not answer in time' in the record, 'completed' replayed; the deadline decides"
    assert told in " ".join(patient.stdout.split())


def test_verify_cannot_compare_a_benchmark_that_is_unknown_here(
    evaluated: tuple[Path, Any], tmp_path: Path, here: Call
) -> None:
    record = Path(evaluated[1]["drives"][0]["record"])
    for suffix in (".json", ".parquet"):
        (tmp_path / f"alone{suffix}").write_bytes(record.with_suffix(suffix).read_bytes())
    told = document(here("verify", str(tmp_path / "alone.json"), "--trust", "--json"))
    assert (told["same"], told["benchmark"]["compared"]) == (True, False)


def test_verify_refuses_a_forged_record(evaluated: tuple[Path, Any], tmp_path: Path, here: Call) -> None:
    record = json.loads(Path(evaluated[1]["drives"][0]["record"]).read_text())
    record["egos"][0]["status"] = "perfect"
    record["egos"][0]["infractions"] = []
    record["egos"][0]["driven_m"] += 1.0
    forged = tmp_path / "forged.json"
    forged.write_text(json.dumps(record))
    result = here("verify", str(forged))
    assert result.returncode == 2
    assert "changed since it was written" in result.stderr


def test_score_recomputes_under_other_rules(evaluated: tuple[Path, Any], here: Call) -> None:
    records = [drive["record"] for drive in evaluated[1]["drives"]]
    for rules in ("1.0", "2.0", "2.1"):
        scored = document(here("score", *records, "--rules", rules, "--irs-length", "route", "--json"))
        assert (scored["rules"], scored["irs_length"]) == (rules, "route")
        assert len(scored["drives"]) == 2


def test_report_compares_folders(evaluated: tuple[Path, Any], tmp_path: Path, here: Call) -> None:
    result = here("report", str(evaluated[0]), str(evaluated[0]), "--out", str(tmp_path / "report.html"))
    assert result.returncode == 2, "the same agent twice is no comparison"
    result = here("report", str(evaluated[0]), "--out", str(tmp_path / "report.html"))
    assert result.returncode == 0, result.stderr
    assert "steady" in result.stdout
    assert "<html" in (tmp_path / "report.html").read_text()[:200]


def test_the_same_command_again_goes_on(evaluated: tuple[Path, Any], short: Path, here: Call) -> None:
    out, printed = evaluated
    again = document(here("evaluate", "--agent", STEADY, "--benchmark", str(short), "--out", str(out), "--json"))
    assert again == printed


def test_settings_reach_the_agent(short: Path, tmp_path: Path, here: Call) -> None:
    arguments = ("--agent", "tests.evaluation.agents:Raises", "--benchmark", str(short), "--seeds", "0", "--json")
    late = here("evaluate", *arguments, "--out", str(tmp_path / "a"), "--set", "after=20")
    early = here("evaluate", *arguments, "--out", str(tmp_path / "b"), "--set", "after=3")
    drives = [json.loads(result.stdout)["drives"][0] for result in (late, early)]
    assert [json.loads(Path(one["record"]).read_text())["egos"][0]["duration_s"] for one in drives] == [2.0, 0.3]


def test_an_agent_that_fails_as_a_program_is_a_line_and_an_exit_code(short: Path, tmp_path: Path, here: Call) -> None:
    arguments = ("--agent", "tests.evaluation.agents:Raises", "--benchmark", str(short), "--out", str(tmp_path))
    for options in ((), ("--json",)):
        result = here("evaluate", *arguments, *options)
        assert result.returncode == 1
        (line,) = result.stderr.splitlines()
        assert line.startswith("dohyo: steady failed as a program in 2 of 2 drives; along-s0: ")
    assert json.loads(result.stdout)["drives"][0]["status"] == "failed: agent raised"


def broken(tmp_path: Path, name: str) -> str:
    """A benchmark on a network file that is no good."""
    net = tmp_path / "bad.net.xml.gz"
    net.write_bytes(gzip.compress(b"<net version='1.16'><edge id='a'><lane id=" + b"x" * 2000)[:400])
    path = tmp_path / name
    path.write_text(SHORT.replace('"ingolstadt"', f'"{net}"'))
    return str(path)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--agent", "autopilo", "--benchmark", "quickstart"], "did you mean 'autopilot'?"),
        (["--agent", "autopilot", "--benchmark", "quickstar"], "did you mean 'quickstart'?"),
        (["--agent", "autopilot", "--benchmark", "missing.toml"], "missing.toml"),
        (["--agent", "autopilot", "--benchmark", "{no_toml}"], "not valid TOML"),
        (["--agent", "autopilot", "--benchmark", "{unknown_key}"], "traffic.vehicels"),
        (["--agent", "autopilot", "--benchmark", "{unreachable}"], "mission 1"),
        (["--agent", "autopilot", "--benchmark", "{no_lane}"], "no lane 'nowhere_0'"),
        (["--agent", "autopilot", "--benchmark", "{unknown_network}"], "did you mean 'ingolstadt'?"),
        (["--agent", "autopilot", "--benchmark", "{broken_net}"], "bad.net.xml.gz"),
        (["--agent", "autopilot", "--benchmark", "quickstart", "--seeds", "0,x"], "--seeds"),
        (["--agent", "autopilot", "--benchmark", "quickstart", "--set", "foo=1"], "max_speed"),
        (["--agent", "autopilot", "--benchmark", "quickstart", "--set", "patience"], "key=value"),
        (["--agent", "autopilot", "--benchmark", "quickstart", "--set", "colour=1"], "colour"),
        (["--agent", "no.such:Agent", "--benchmark", "quickstart"], "No module named"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(
    arguments: list[str],
    says: str,
    tmp_path: Path,
    here: Call,
) -> None:
    variants = {
        "no_toml": "name = [",
        "unknown_key": SHORT.replace("vehicles =", "vehicels ="),
        "unreachable": SHORT.replace('"737320747#4_2", position_m = 20.0', '"29119849#1_2", position_m = 20.0'),
        "no_lane": SHORT.replace("737320747#4_2", "nowhere_0"),
        "unknown_network": SHORT.replace("ingolstadt", "ingolstat"),
    }
    paths = {"broken_net": broken(tmp_path, "broken.toml")}
    for name, text in variants.items():
        paths[name] = str(tmp_path / f"{name}.toml")
        Path(paths[name]).write_text(text)
    out = tmp_path / "out"
    result = here("evaluate", *[part.format(**paths) for part in arguments], "--out", str(out))
    assert result.returncode == 2
    assert says in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert result.stderr.startswith("dohyo: ")
    assert not out.exists()


def test_an_agent_of_ones_own_is_found_in_the_working_folder(short: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "import numpy as np\n"
        "from dohyo.evaluation.agent import Agent, AgentSpec\n"
        "class Mine(Agent):\n"
        "    spec = AgentSpec(name='mine', sensors=('speedometer',), control='lane_command')\n"
        "    def act(self, observation):\n"
        "        return np.array([6.0, 0.0])\n"
    )
    result = dohyo(
        *("evaluate", "--agent", "mine:Mine", "--benchmark", str(short), "--seeds", "0", "--json"), cwd=tmp_path
    )
    assert document(result)["agent"] == "mine"


def test_lists_of_benchmarks_and_agents_keep_their_names_whole_on_80_columns(here: Call) -> None:
    for what in ("benchmarks", "agents"):
        listed = document(here(what, "list", "--json"))
        shown = dohyo(what, "list", columns=80).stdout.splitlines()
        assert max(map(len, shown)) <= 80
        assert {one["name"] for one in listed} <= {line.split()[0] for line in shown if not line.startswith(" ")}


def test_a_part_of_a_benchmark_is_marked_by_every_command(tmp_path: Path, here: Call) -> None:
    second = SHORT[SHORT.index("[[missions]]") :].replace("along", "again")
    (tmp_path / "two.toml").write_text(SHORT + second)
    order = ["--agent", STEADY, "--benchmark", str(tmp_path / "two.toml"), "--seeds", "0", "--out", str(tmp_path / "a")]
    words = "part of short: 1 of 2 missions"

    shown = here("evaluate", *order, "--only", "again")
    assert f"{words}; the scores are not those of the benchmark" in shown.stdout
    printed = document(here("evaluate", *order, "--only", "again", "--json"))
    assert (printed["part"], printed["missions"]) == (words, ["again"])
    compared = here("report", str(tmp_path / "a"), "--out", str(tmp_path / "report.html"))
    assert f"{words}; the scores are not" in compared.stdout
    record = tmp_path / "a" / "records" / "again-s0.json"
    verified = document(here("verify", str(record), "--trust", "--json"))
    assert (verified["same"], verified["part"]) == (True, words)
    assert f"{words}; the scores are not" in here("score", str(record)).stdout

    refused = here("evaluate", *order, "--only", "along")
    assert (refused.returncode, "choose another --out" in refused.stderr) == (2, True)
    unknown = here("evaluate", *order, "--only", "agin")
    assert "no cell or mission named 'agin'; did you mean 'again'?" in unknown.stderr
    assert "sample: expected 1 to 2 missions, got 3" in here("evaluate", *order, "--sample", "3").stderr
    assert "--only" in here("evaluate", *order, "--only", "again,").stderr


def test_missing_episodes_are_marked_by_every_command(
    evaluated: tuple[Path, Any], short: Path, tmp_path: Path, here: Call
) -> None:
    shutil.copytree(evaluated[0], tmp_path / "a")
    (tmp_path / "a" / "records" / "along-s1.json").unlink()
    record, words = tmp_path / "a" / "records" / "along-s0.json", "part of short: 1 of 2 episodes"
    compared = here("report", str(tmp_path / "a"), "--out", str(tmp_path / "report.html"))
    assert f"steady: {words}; the scores are not those of the" in compared.stdout
    assert f"{words}. Its scores are not those of the benchmark." in (tmp_path / "report.html").read_text()
    assert f"{words}; the scores are not" in here("score", str(record)).stdout
    assert document(here("verify", str(record), "--signature-only", "--json"))["part"] == words
    order = ["--agent", STEADY, "--benchmark", str(short), "--out", str(tmp_path / "a"), "--json"]
    assert document(here("evaluate", *order))["part"] is None, "it has driven what was missing"
