"""`dohyo report` and `dohyo score` by the rules of the benchmark, on a hand-made record."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.records.store import seal, write_record
from dohyo.evaluation.running.manifest import MANIFEST, RECORDS, manifest_of
from dohyo.service.cli import app
from tests.evaluation.builders import AGENT, drive, ego, episode, infraction

STRICT: Benchmark = load_benchmark("quickstart").model_copy(update={"name": "strict", "rules": "2.1"})
BY_RULES = {"1.0": 80.0 * 0.6 * 0.7, "2.0": 80.0 * 0.6 * 0.7, "2.1": 80.0 / (1.0 + 0.7 + 0.4)}
"""Driving score of 80 % of a route with a collision and a red light."""
dohyo = CliRunner()


@pytest.fixture
def record(tmp_path: Path) -> Path:
    """A record of a benchmark with rules 2.1, in its result folder."""
    scenario = STRICT.scenarios([0])[0]
    found = (infraction(InfractionKind.COLLISION_VEHICLE), infraction(InfractionKind.RED_LIGHT))
    made = episode(ego(*found, name=scenario.missions[0].name), benchmark=(STRICT.name, STRICT.sha256))
    path = write_record(
        tmp_path / "run" / RECORDS, f"{scenario.name}-s0", seal(made.model_copy(update={"scenario": scenario})), drive()
    )
    manifest = manifest_of({"ego": AGENT}, STRICT, STRICT.sha256, (scenario.name,), [0])
    (tmp_path / "run" / MANIFEST).write_text(manifest.model_dump_json())
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
