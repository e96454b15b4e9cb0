"""`dohyo evaluate`, `verify`, `report` and `benchmarks` on parking."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dohyo.agents.registry import describe_agent
from dohyo.evaluation.parking.benchmark import load_parking_benchmark
from dohyo.evaluation.parking.lot_files import LotsManifest, write_lot
from dohyo.evaluation.parking.record import read_records, write_records
from dohyo.evaluation.parking.running import Order, drive_here
from dohyo.service.cli import main

AGENT = ("--agent", "tests.evaluation.parking.parkers:Greedy")


def dohyo(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["dohyo", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_an_agent_is_evaluated_verified_and_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, page = tmp_path / "out", tmp_path / "page.html"
    order = ("evaluate", *AGENT, "--benchmark", "parking-simple", "--seeds", "0-3", "--out", out)
    assert dohyo(monkeypatch, *order) == 0
    assert "success, %" in capsys.readouterr().out
    assert dohyo(monkeypatch, *order, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["estimates"]["success"]["n"] == 4
    assert [lot["seed"] for lot in document["lots"]] == [0, 1, 2, 3]

    assert dohyo(monkeypatch, "verify", out / "records.jsonl") == 2
    assert "no installed package registers" in capsys.readouterr().err
    assert dohyo(monkeypatch, "verify", out / "records.jsonl", "--trust") == 0
    assert "same: all 4 lots" in capsys.readouterr().out
    assert dohyo(monkeypatch, "verify", out / "records.jsonl", "--signature-only") == 2
    assert "not signed" in capsys.readouterr().err

    assert dohyo(monkeypatch, "report", out, "--out", page) == 0
    assert page.read_text().count('<svg class="plan"') == 4

    (out / "motion.parquet").unlink()
    assert dohyo(monkeypatch, "verify", out / "records.jsonl", "--trust") == 2
    assert "expected the motion of parking" in capsys.readouterr().err.replace("\n", " ")


def test_the_deadline_is_that_of_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    order = ("evaluate", "--agent", "tests.evaluation.parking.parkers:Sleeper", "--benchmark", "parking-simple")
    assert dohyo(monkeypatch, *order, "--seeds", "0", "--deadline", "3", "--out", tmp_path) == 1
    assert "took longer than 3 s" in capsys.readouterr().err.replace("\n", " ")
    verify = ("verify", tmp_path / "records.jsonl", "--trust", "--deadline")
    assert dohyo(monkeypatch, *verify, "3") == 0, "its drive is judged again as it was"
    assert dohyo(monkeypatch, *verify, "4") == 1


@pytest.mark.parametrize("workers", [1, 2])
def test_an_agent_that_ends_its_process_fails_its_lot_and_the_command_says_so(
    workers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    agent = ("--agent", "tests.evaluation.parking.parkers:Fatal", "--set", "fault=exit", "--set", "lot=1")
    order = ("evaluate", *agent, "--benchmark", "parking-simple", "--seeds", "0-2", "--workers", workers)
    assert dohyo(monkeypatch, *order, "--out", tmp_path) == 1
    said = "greedy failed as a program in 1 of 3 karts; lot 1: the process died twice while the agent was called"
    assert said in capsys.readouterr().err


def test_evaluations_without_a_common_lot_are_reported_side_by_side(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    order, page = ("evaluate", *AGENT, "--benchmark", "parking-simple"), tmp_path / "page.html"
    for name, seeds in (("a", "0-1"), ("b", "2-3"), ("c", "0-3")):
        assert dohyo(monkeypatch, *order, "--seeds", seeds, "--out", tmp_path / name) == 0
    capsys.readouterr()
    assert dohyo(monkeypatch, "report", *(tmp_path / name for name in "abc"), "--out", page) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "greedy (a) and greedy (b) have no common lot" in said
    assert re.search(r"greedy \(a\) (<|=|>) greedy \(c\): success differs by .* on 2 common lots", said)
    assert '<p class="note">greedy (a) and greedy (b) have no common lot.</p>' in page.read_text()


def test_folders_of_one_name_are_told_by_the_folders_around_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    order, page = ("evaluate", *AGENT, "--benchmark", "parking-simple", "--seeds"), tmp_path / "page.html"
    folders = [tmp_path / name for name in ("a/lots", "b/lots", "c/lots")]
    for folder, seeds in zip(folders, ("0-1", "0-1", "2-4"), strict=True):
        assert dohyo(monkeypatch, *order, seeds, "--out", folder) == 0
    capsys.readouterr()
    assert dohyo(monkeypatch, "report", *folders, "--out", page) == 0
    said = capsys.readouterr().out
    assert all(said.count(f"greedy ({name}/lots) ") >= 2 for name in "abc")
    assert "greedy (a/lots) = greedy (b/lots): success differs by 0" in " ".join(said.split())
    assert dohyo(monkeypatch, "report", folders[0], folders[0], "--out", page) == 2
    assert "expected each agent once in each result folder" in " ".join(capsys.readouterr().err.split())


def test_a_report_of_several_versions_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, old, page = tmp_path / "out", tmp_path / "old", tmp_path / "page.html"
    order = ("evaluate", *AGENT, "--benchmark", "parking-simple", "--seeds", "0-1", "--out", out)
    assert dohyo(monkeypatch, *order) == 0
    records = read_records(out / "records.jsonl")
    write_records(old, [record.model_copy(update={"version": "0.9.0"}).sealed() for record in records])
    capsys.readouterr()
    assert dohyo(monkeypatch, "report", out, "--out", page) == 0
    assert "take care" not in capsys.readouterr().out
    assert dohyo(monkeypatch, "report", out, old, "--out", page) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("take care: different")]
    assert line.endswith(f"greedy (out): dohyo {records[0].version}; greedy (old): dohyo 0.9.0")


def test_a_report_of_an_unfinished_run_says_so_and_counts_each_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Three of four lots that were ordered at a service are there; agents failed in two ways."""
    entry, benchmark = "tests.evaluation.parking.parkers:Broken", load_parking_benchmark("parking-simple")
    info, folder, page = describe_agent(entry, {}), tmp_path / "fetched", tmp_path / "page.html"
    for drive in drive_here(Order(benchmark, info, {}, 10.0), [0, 1, 2]):
        seed, (kart,) = drive.record.seed, drive.record.karts
        told = drive.record.model_copy(
            update={"karts": (kart.model_copy(update={"failure": "too late" if seed == 1 else "no way"}),)}
        )
        write_lot(folder / "records", f"lot-s{seed}", replace(drive, record=told.sealed()))
    facts: dict[str, Any] = {"agent": info, "benchmark": benchmark, "benchmark_sha256": benchmark.sha256}
    for seeds, part in ((range(4), "part of parking-simple: 3 of 4 lots"), (range(3), ""), (None, "")):
        manifest = LotsManifest(**facts, seeds=None if seeds is None else tuple(seeds))
        (folder / "evaluation.json").write_text(manifest.model_dump_json())
        assert dohyo(monkeypatch, "report", folder, "--out", page) == 0
        said = " ".join(capsys.readouterr().out.split())
        assert "greedy failed in 3 karts: no way (2); too late (1)" in said
        assert (f"greedy: {part}; the scores are not those of the benchmark" in said) == bool(part)
        assert (f"<b>greedy</b>: {part}. Its scores are not those of the benchmark." in page.read_text()) == bool(part)


def test_the_registered_agents_park_and_are_verified_without_trust(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("parking", "parking-expert"):
        order = ("evaluate", "--agent", name, "--benchmark", "parking-complex", "--seeds", "0-1", "--workers", "1")
        assert dohyo(monkeypatch, *order, "--out", tmp_path / name) == 0
        assert dohyo(monkeypatch, "verify", tmp_path / name / "records.jsonl") == 0
        assert "same: all 2 lots" in capsys.readouterr().out
    assert dohyo(monkeypatch, "agents", "list", "--json") == 0
    listed = {one["name"]: one["family"] for one in json.loads(capsys.readouterr().out)}
    assert (listed["parking"], listed["parking-expert"], listed["idm"]) == ("parking", "parking", "driving")


@pytest.mark.parametrize(
    ("agent", "benchmark"), [("idm", "parking-complex"), ("parking", "quickstart"), ("parking-expert", "quickstart")]
)
def test_agents_of_the_other_kind_are_refused_by_name(agent, benchmark, monkeypatch, capsys, tmp_path):
    assert dohyo(monkeypatch, "evaluate", "--agent", agent, "--benchmark", benchmark, "--out", tmp_path / "out") == 2
    said = " ".join(capsys.readouterr().err.split())
    assert re.search(f"benchmark '{benchmark}': expected agents that .*, and '{agent}' has control", said)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("evaluate", *AGENT, "--benchmark", "parking-simple", "--sample", "2"), "--sample: expected a benchmark of"),
        (("benchmarks", "prepare", "parking-simple"), "nothing to prepare"),
    ],
)
def test_what_parking_has_not_is_refused(arguments, said, monkeypatch, capsys):
    assert dohyo(monkeypatch, *arguments) == 2
    assert said in capsys.readouterr().err.replace("\n", " ")


def test_the_list_has_parking_and_its_versions(monkeypatch, capsys):
    assert dohyo(monkeypatch, "benchmarks", "list", "--json") == 0
    (found,) = [one for one in json.loads(capsys.readouterr().out) if one["name"] == "parking-three"]
    assert (found["scenarios"], found["headline"], len(found["version"])) == (2000, "success", 12)
