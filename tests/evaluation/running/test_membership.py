"""Records against the benchmark that they name: hand-made ones, whose hashes are right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.records.store import seal, write_record
from dohyo.evaluation.running.manifest import MANIFEST, RECORDS, manifest_of
from dohyo.evaluation.running.membership import benchmark_of_record
from dohyo.evaluation.running.run import read_result
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Scenario, Traffic
from tests.evaluation.builders import AGENT, drive, ego, episode

QUICKSTART = load_benchmark("quickstart")
EMPTY = Traffic(vehicles=0, pedestrians=0)


def record_of(scenario: Scenario, benchmark: tuple[str, str] | None) -> EpisodeRecord:
    """A sealed record of a scenario that was driven without a flaw."""
    made = episode(ego(name=scenario.missions[0].name, status=Status.PERFECT, progress_m=1000.0), benchmark=benchmark)
    return seal(made.model_copy(update={"scenario": scenario}))


def result_folder(
    out: Path, scenario: Scenario, benchmark: Benchmark = QUICKSTART, named: tuple[str, str] | None = None
) -> Path:
    """A result folder of a benchmark with one record; returns the path of the record."""
    (out / RECORDS).mkdir(parents=True)
    manifest = manifest_of({"ego": AGENT}, benchmark, benchmark.sha256)
    (out / MANIFEST).write_text(manifest.model_dump_json())
    record = record_of(scenario, named or (benchmark.name, benchmark.sha256))
    return write_record(out / RECORDS, f"{scenario.name}-s{scenario.seed}", record, drive())


def changed(**fields: Any) -> Scenario:
    return QUICKSTART.scenarios([1])[2].model_copy(update=fields)


def test_records_of_the_benchmark_are_read(tmp_path: Path) -> None:
    result_folder(tmp_path, QUICKSTART.scenarios([1])[2])
    assert read_result(tmp_path).records[0].scenario == QUICKSTART.scenarios([1])[2]


@pytest.mark.parametrize(
    ("scenario", "says"),
    [
        (changed(traffic=EMPTY), "with other traffic$"),
        (changed(time_limit_s=9999.0, conditions="night"), "with other conditions, time_limit_s$"),
        (changed(seed=7, missions=QUICKSTART.scenarios([7])[0].missions), "seed 7 .* with other missions$"),
        (changed(name="nowhere"), "expected a scenario of benchmark quickstart .*, got 'nowhere'$"),
    ],
)
def test_an_easier_scenario_under_the_benchmarks_hash_is_refused(tmp_path: Path, scenario: Scenario, says: str) -> None:
    path = result_folder(tmp_path, scenario)
    with pytest.raises(InvalidInputError, match=says) as refused:
        read_result(tmp_path)
    assert str(refused.value).startswith(f"{path}: expected")
    assert QUICKSTART.sha256[:8] in str(refused.value)


def test_a_record_of_another_benchmark_is_refused(tmp_path: Path) -> None:
    path = result_folder(tmp_path, QUICKSTART.scenarios([0])[0], named=("quickstart", "0" * 64))
    says = f"expected a record of benchmark quickstart {QUICKSTART.sha256[:8]}, got one of 'quickstart' '00000000'"
    with pytest.raises(InvalidInputError, match=says):
        read_result(tmp_path)
    with pytest.raises(InvalidInputError, match=says):
        benchmark_of_record(record_of(changed(), ("quickstart", "0" * 64)), path)
    with pytest.raises(InvalidInputError, match="got one of no benchmark"):
        benchmark_of_record(record_of(changed(), None), path)


@pytest.mark.parametrize(
    ("driver", "says"), [({"settings": {"speed_mps": 5.0}}, "settings"), ({"name": "other"}, "name")]
)
def test_a_record_of_another_agent_is_refused(tmp_path: Path, driver: dict[str, Any], says: str) -> None:
    path = result_folder(tmp_path, QUICKSTART.scenarios([1])[2])
    manifest = manifest_of({"ego": AGENT.model_copy(update=driver)}, QUICKSTART, QUICKSTART.sha256)
    (tmp_path / MANIFEST).write_text(manifest.model_dump_json())
    with pytest.raises(InvalidInputError, match=rf"driven by agent .*, got agent .* with other {says}$") as refused:
        read_result(tmp_path)
    assert str(refused.value).startswith(f"{path}: expected")


def test_missions_with_seeds_of_their_own_are_found(tmp_path: Path) -> None:
    benchmark = load_benchmark("val14")
    scenario = benchmark.scenarios([0])[5]
    result_folder(tmp_path / "right", scenario, benchmark)
    assert read_result(tmp_path / "right").records[0].scenario == scenario
    result_folder(tmp_path / "wrong", scenario.model_copy(update={"seed": scenario.seed + 1}), benchmark)
    with pytest.raises(InvalidInputError, match=r"with other seed$"):
        read_result(tmp_path / "wrong")


def test_a_record_alone_finds_its_benchmark_in_the_catalog(tmp_path: Path) -> None:
    """By name and hash; a name is never a path, since the record's author chose it."""
    alone, own = tmp_path / "one.json", tmp_path / "own.toml"
    own.write_text('name = "own"')
    assert benchmark_of_record(record_of(changed(), ("quickstart", QUICKSTART.sha256)), alone) == QUICKSTART
    for named in (None, ("quickstart", "0" * 64), ("unheard-of", QUICKSTART.sha256), (str(own), "0" * 64)):
        assert benchmark_of_record(record_of(changed(), named), alone) is None
