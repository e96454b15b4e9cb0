"""`dohyo report`, `dohyo score` and `dohyo verify` on hand-made records: rules, damaged files, few drives."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.freeway.day import DayRecord
from dohyo.evaluation.freeway.morning import MorningRecord
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.records.store import seal, write_record
from dohyo.evaluation.running.manifest import MANIFEST, RECORDS, manifest_of
from dohyo.service.cli import app
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.builders import AGENT, drive, ego, episode, infraction, lost
from tests.service.records import day, fetched, lot, morning

STRICT: Benchmark = load_benchmark("quickstart").model_copy(update={"name": "strict", "rules": "2.1"})
BY_RULES = {"1.0": 80.0 * 0.6 * 0.7, "2.0": 80.0 * 0.6 * 0.7, "2.1": 80.0 / (1.0 + 0.7 + 0.4)}
"""Driving score of 80 % of a route with a collision and a red light."""
dohyo = CliRunner()


def driven(folder: Path, seeds: Sequence[int] = (0,), agent: AgentInfo = AGENT, flaws: int = 2) -> Path:
    """A result folder of a benchmark with rules 2.1: one mission, with a collision and a red light in each drive."""
    for seed in seeds:
        scenario = STRICT.scenarios([seed])[0]
        found = (infraction(InfractionKind.COLLISION_VEHICLE), infraction(InfractionKind.RED_LIGHT))[:flaws]
        driver = ego(*found, name=scenario.missions[0].name, agent=agent)
        made = episode(driver, benchmark=(STRICT.name, STRICT.sha256)).model_copy(update={"scenario": scenario})
        write_record(folder / RECORDS, f"{scenario.name}-s{seed}", seal(made), drive())
    manifest = manifest_of({"ego": agent}, STRICT, STRICT.sha256, (scenario.name,), seeds)
    (folder / MANIFEST).write_text(manifest.model_dump_json())
    return folder


@pytest.fixture
def record(tmp_path: Path) -> Path:
    """The record of such a folder."""
    (path,) = (driven(tmp_path / "run") / RECORDS).glob("*.json")
    return path


@pytest.mark.parametrize(("options", "rules"), [((), "2.1"), (("--rules", "2.0"), "2.0"), (("--rules", "2.1"), "2.1")])
def test_scores_are_by_the_rules_of_the_benchmark(options: tuple[str, ...], rules: str, record: Path) -> None:
    done = dohyo.invoke(app, ["score", str(record), "--json", *options])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert told["rules"] == rules
    assert told["scores"]["driving_score"]["mean"] == pytest.approx(BY_RULES[rules])
    assert told["drives"][0]["driving_score"] == pytest.approx(BY_RULES[rules])

    page = record.parents[2] / "report.html"
    done = dohyo.invoke(app, ["report", str(record.parents[1]), "--out", str(page), *options])
    assert done.exit_code == 0, done.output
    assert f"rules {rules}" in done.output
    assert f"{BY_RULES[rules]:.1f}" in page.read_text()


def test_a_record_of_no_benchmark_here_is_scored_by_rules_2(record: Path, tmp_path: Path) -> None:
    (tmp_path / "run" / MANIFEST).unlink()
    told = json.loads(dohyo.invoke(app, ["score", str(record), "--json"]).stdout)
    assert told["rules"] == "2.0"


def test_records_of_several_versions_are_told_by_score(tmp_path: Path) -> None:
    """As `dohyo report` tells them: versions alone may change scores."""
    paths = []
    for seed, version in enumerate(("6.5.0", "7.0.0")):
        made = episode(ego(), name="town").model_copy(update={"scenario": STRICT.scenarios([seed])[0]})
        made = made.model_copy(update={"versions": made.versions.model_copy(update={"dohyo": version})})
        paths.append(str(write_record(tmp_path, f"m-s{seed}", seal(made), drive())))
    done = dohyo.invoke(app, ["score", *paths], env={"COLUMNS": "300"})
    assert "take care: different versions drove these episodes" in done.output
    assert "dohyo 6.5.0, 7.0.0" in done.output
    assert "6.5.0, 7.0.0" in json.loads(dohyo.invoke(app, ["score", *paths, "--json"]).stdout)["mixed_versions"]
    assert "mixed_versions" not in json.loads(dohyo.invoke(app, ["score", paths[0], "--json"]).stdout)


def test_lost_drives_alone_have_no_scores_of_drives(tmp_path: Path) -> None:
    path = write_record(tmp_path, "gone-s0", seal(lost()), drive())
    done = dohyo.invoke(app, ["score", str(path)], env={"COLUMNS": "300"})
    assert done.exit_code == 0, done.output
    assert "gone-s0" not in done.output
    assert re.search(r"lost \(gridlock, infrastructure\) +1", done.output)


def truncate(table: Path) -> None:
    table.write_bytes(table.read_bytes()[:-1])


def swap(table: Path) -> None:
    other = write_record(table.parents[2], "other", seal(episode(trajectory=drive(30))), drive(30))
    other.with_suffix(".parquet").replace(table)


@pytest.mark.parametrize("damage", [Path.unlink, truncate, swap], ids=["missing", "truncated", "swapped"])
def test_a_record_without_its_trajectories_is_refused_by_every_command(
    damage: Callable[[Path], None], record: Path
) -> None:
    table = record.with_suffix(".parquet")
    assert dohyo.invoke(app, ["verify", str(record), "--signature-only"]).exit_code == 0
    damage(table)
    page = record.parents[2] / "report.html"
    for command in (
        ("verify", record),
        ("verify", record, "--signature-only"),
        ("score", record),
        ("report", record.parents[1], "--out", page),
        ("explain", record, "--time", "1"),
    ):
        refused = dohyo.invoke(app, list(map(str, command))).exception
        assert isinstance(refused, InvalidInputError), command
        assert str(refused).startswith(f"{table}: "), command
    assert not page.exists()


@pytest.mark.parametrize(
    ("record", "what"),
    [(day(), "a day of forecasts; "), (morning(), "a morning on the freeway; ")],
    ids=["day", "morning"],
)
def test_an_intact_record_without_drives_is_called_what_it_is(
    record: DayRecord | MorningRecord, what: str, tmp_path: Path
) -> None:
    """It is not called changed, and each refusal names a command that reads it."""
    path = fetched(tmp_path / "run", record)
    assert dohyo.invoke(app, ["verify", str(path), "--signature-only"]).exit_code == 0
    for command in (["score", str(path)], ["explain", str(path), "--time", "1"]):
        refused = str(dohyo.invoke(app, command).exception)
        assert refused.startswith(f"{path}: {what}it has no drives on roads: `dohyo verify`"), command
    refused = str(dohyo.invoke(app, ["report", str(tmp_path / "run"), "--out", str(tmp_path / "a.html")]).exception)
    assert "no drives on roads" in refused
    assert "`dohyo evaluations watch ID`" in refused


def test_a_morning_takes_no_policy(tmp_path: Path) -> None:
    path = fetched(tmp_path / "run", morning())
    refused = dohyo.invoke(app, ["verify", str(path), "--policy", str(path)]).exception
    assert str(refused) == f"'{path}': --policy is for records of drives, lots and days"


def test_an_intact_lot_is_called_one_by_score(tmp_path: Path) -> None:
    path = tmp_path / "lot-s5.json"
    path.write_text(lot().model_dump_json())
    refused = str(dohyo.invoke(app, ["score", str(path)]).exception)
    assert refused.startswith(f"{path}: a parking lot; it has no drives on roads: `dohyo verify`")
    (tmp_path / "records.jsonl").write_text(lot().model_dump_json() + "\n")
    refused = str(dohyo.invoke(app, ["score", str(tmp_path / "records.jsonl")]).exception)
    assert "records of parking, whose scores `dohyo report FOLDER` has" in refused


def test_a_result_on_the_freeway_has_its_report_beside_it(tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text('{"record_hash": "0", "reference_units": {}}')
    refused = str(dohyo.invoke(app, ["report", str(tmp_path)]).exception)
    assert refused == f"'{tmp_path}': a result on the freeway, whose report is '{tmp_path / 'report.html'}'"
    refused = str(dohyo.invoke(app, ["score", str(tmp_path / "result.json")]).exception)
    assert "a result of `dohyo evaluate` on the freeway" in refused


@pytest.mark.parametrize(
    ("seeds", "ends"),
    [
        ([0], "on 1 common drive, too few to decide"),
        (range(5), "on 5 common drives, too few to decide"),
        (range(6), "on 6 common drives, P(other > tester) > 0.999"),
    ],
)
def test_few_drives_decide_nothing_and_have_no_probability(seeds: Sequence[int], ends: str, tmp_path: Path) -> None:
    folders = [
        driven(tmp_path / "other", seeds, AGENT.model_copy(update={"name": "other"}), flaws=0),
        driven(tmp_path / "tester", seeds),
    ]
    page = tmp_path / "report.html"
    done = dohyo.invoke(app, ["report", *map(str, folders), "--out", str(page)])
    assert done.exit_code == 0, done.output
    assert f"report: {page.resolve()}" in done.output.splitlines()
    sign = "=" if "too few" in ends else ">"
    (said,) = re.findall(r"other [<=>] tester: .*", done.output)
    assert said.startswith(f"other {sign} tester: driving score differs by ")
    assert ends in said
    assert ("P(" in said) == ("P(" in ends)
