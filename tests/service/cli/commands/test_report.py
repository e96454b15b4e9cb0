"""`dohyo report` on hand-made result folders: headlines, agents that cannot be compared, equal names, versions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.records.record import AgentInfo, EgoRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.records.store import seal, write_record
from dohyo.evaluation.running.manifest import MANIFEST, RECORDS, manifest_of
from dohyo.service.cli import app
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from tests.evaluation.builders import AGENT, drive, ego, episode

QUICK: Benchmark = load_benchmark("quickstart")
OTHER = AGENT.model_copy(update={"name": "other"})


def folder_of(
    folder: Path,
    benchmark: Benchmark,
    agent: AgentInfo = AGENT,
    scenarios: Sequence[int] = (0,),
    dohyo: str = "1.0.0",
    **driven: object,
) -> str:
    """A result folder with one drive of each of some scenarios of a benchmark."""
    chosen = [benchmark.scenarios(benchmark.seeds[:1])[i] for i in scenarios]
    for scenario in chosen:
        drives: list[EgoRecord] = [ego(name=one.name, agent=agent, **driven) for one in scenario.missions]  # type: ignore[arg-type]
        made = episode(*drives, benchmark=(benchmark.name, benchmark.sha256))
        roads = {"network_sha256": load_network(scenario.network).sha256} if scenario.reference_m is not None else {}
        versions = made.versions.model_copy(update={"dohyo": dohyo, **roads})
        made = made.model_copy(update={"scenario": scenario, "versions": versions})
        write_record(folder / RECORDS, f"{scenario.name}-s{scenario.seed}", seal(made), drive())
    names = tuple(scenario.name for scenario in chosen)
    manifest = manifest_of({"ego": agent}, benchmark, benchmark.sha256, names, benchmark.seeds[:1])
    (folder / MANIFEST).write_text(manifest.model_dump_json())
    return str(folder)


def report(tmp_path: Path, *folders: str) -> Result:
    return CliRunner(env={"COLUMNS": "300"}).invoke(app, ["report", *folders, "--out", str(tmp_path / "page.html")])


@pytest.mark.parametrize(
    ("name", "score"), [("nocrash", "NoCrash success"), ("quickstart", "driving score"), ("endurance", "2500 m")]
)
def test_the_verdict_is_by_the_headline_of_the_benchmark(name: str, score: str, tmp_path: Path) -> None:
    benchmark = load_benchmark(name)
    done = report(tmp_path, folder_of(tmp_path / "a", benchmark), folder_of(tmp_path / "b", benchmark, OTHER))
    assert done.exit_code == 0, done.output
    assert f"other = tester: {score} differs by 0 on 1 common drive" in done.output


def test_the_verdict_of_a_closed_loop_benchmark_is_by_its_score(tmp_path: Path) -> None:
    val14 = load_benchmark("val14-reactive")
    done = report(tmp_path, folder_of(tmp_path / "a", val14), folder_of(tmp_path / "b", val14, OTHER))
    assert done.exit_code == 0, done.output
    assert "other = tester: closed-loop score differs by 0 on 1 common drive" in done.output
    assert "driving score differs" not in done.output


@pytest.mark.parametrize("name", ["quickstart", "val14-reactive"])
@pytest.mark.parametrize("lost", [False, True], ids=["of other scenarios", "all lost"])
def test_agents_without_a_common_drive_are_reported(name: str, lost: bool, tmp_path: Path) -> None:
    benchmark = load_benchmark(name)
    first = folder_of(tmp_path / "a", benchmark)
    second = (
        folder_of(tmp_path / "b", benchmark, OTHER, status=Status.SIMULATION)
        if lost
        else folder_of(tmp_path / "b", benchmark, OTHER, scenarios=(1,))
    )
    done = report(tmp_path, first, second)
    assert done.exit_code == 0, done.output
    pair = "tester and other" if lost else "other and tester"  # the better one, then by name
    assert done.output.count(f"{pair} have no common drive: same scenario, seed and ego") == 1
    assert (tmp_path / "page.html").exists()


def test_agents_with_equal_settings_have_the_names_of_their_folders(tmp_path: Path) -> None:
    before, after = (folder_of(tmp_path / name, QUICK) for name in ("before", "after"))
    done = report(tmp_path, before, after)
    assert done.exit_code == 0, done.output
    assert "tester (after) = tester (before): driving score differs by 0" in done.output
    assert "tester (before)" in (tmp_path / "page.html").read_text()


def test_folders_of_one_name_are_told_by_the_folders_around_them(tmp_path: Path) -> None:
    folders = [folder_of(tmp_path / name / "mine", QUICK) for name in ("a", "b")]
    done = report(tmp_path, *folders)
    assert done.exit_code == 0, done.output
    assert "tester (a/mine) = tester (b/mine): driving score differs by 0" in done.output
    assert "tester (b/mine)" in (tmp_path / "page.html").read_text()
    refused = report(tmp_path, *folders, folders[0]).exception
    assert isinstance(refused, InvalidInputError)
    assert "expected each agent once in each result folder, got several of tester (mine)" in str(refused)


def test_versions_that_differ_are_named_in_one_line(tmp_path: Path) -> None:
    first = folder_of(tmp_path / "a", QUICK)
    same = report(tmp_path, first, folder_of(tmp_path / "b", QUICK, OTHER))
    assert "different versions" not in same.output
    mixed = report(tmp_path, first, folder_of(tmp_path / "c", QUICK, OTHER, dohyo="0.9.0"))
    (line,) = [line for line in mixed.output.splitlines() if "different versions" in line]
    assert line.endswith("tester: dohyo 1.0.0, SUMO 1.28.0; other: dohyo 0.9.0, SUMO 1.28.0")
