"""Results on the freeway: what follows from the facts of days or seeds, the hash, the folder and the page."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from dohyo.evaluation.freeway.benchmark import load_freeway_benchmark
from dohyo.evaluation.freeway.page import finding, page, write_page
from dohyo.evaluation.freeway.result import (
    RESULT,
    AgentFacts,
    FreewayResult,
    Metric,
    Units,
    claim,
    rows,
    write_result,
)
from dohyo.sumo_networks.errors import InvalidInputError

METRICS = (Metric("mse", "error", "x 10^3", "lower"), Metric("rmse", "its root", "km/h", "lower", root=True))


def units(*values: float) -> Units:
    return {f"day-{number}": {"mse": value, "rmse": value} for number, value in enumerate(values)}


def result(ours: Units, theirs: Units, name: str = "mine") -> FreewayResult:
    benchmark = load_freeway_benchmark("forecast-hard")
    agent = AgentFacts(name, {"exported": True}, "ab" * 32)
    return FreewayResult(benchmark, agent, "persistence", METRICS, ours, theirs, {"sumo": "1"}, {"latency_ms": 0.5})


def test_means_roots_and_paired_differences() -> None:
    got = result(units(*[1.0, 4.0, 9.0, 16.0] * 2), units(*[2.0, 8.0, 18.0, 32.0] * 2))
    assert got.estimates["mse"].mean == pytest.approx(7.5)
    assert got.estimates["rmse"].mean == pytest.approx(7.5**0.5)
    assert got.estimates["rmse"].low == pytest.approx((got.estimates["mse"].low or 0.0) ** 0.5)
    first, second = rows(got)
    assert first.verdict == "<"
    assert first.percent is not None
    assert first.percent.mean == pytest.approx(-50.0)
    assert second.percent is None  # it would only repeat that of the squares
    assert "less than persistence's 15.0" in finding(got)


def test_what_is_no_better_is_not_significantly_different() -> None:
    got = result(units(1.0, 4.0, 9.0), units(4.0, 1.0, 9.0))
    assert next(rows(got)).verdict == "="
    assert "not significantly different" in finding(got)


def test_the_hash_is_of_the_facts_and_not_of_the_clock() -> None:
    one = result(units(1.0, 2.0), units(2.0, 3.0))
    assert dataclasses.replace(one, timing={"latency_ms": 9.0}).record_hash == one.record_hash
    assert result(units(1.0, 2.1), units(2.0, 3.0)).record_hash != one.record_hash


def test_a_folder_keeps_its_evaluation(tmp_path: Path) -> None:
    one = result(units(1.0, 2.0), units(2.0, 3.0))
    claim(tmp_path, one.benchmark, one.agent)
    document = json.loads(write_result(tmp_path, one).read_text())
    assert document["record_hash"] == one.record_hash
    assert document["scores"]["mse"]["difference"]["verdict"] == "=", "two days show nothing"
    claim(tmp_path, one.benchmark, one.agent)
    for other in (dataclasses.replace(one.agent, name="other"), dataclasses.replace(one.agent, settings={})):
        with pytest.raises(InvalidInputError, match="holds another evaluation"):
            claim(tmp_path, one.benchmark, other)
    with pytest.raises(InvalidInputError, match="holds another evaluation"):
        claim(tmp_path, load_freeway_benchmark("forecast-easy"), one.agent)
    (tmp_path / RESULT).write_text("{}")
    with pytest.raises(InvalidInputError, match="cannot be read"):
        claim(tmp_path, one.benchmark, one.agent)


def test_a_folder_of_driving_is_refused(tmp_path: Path) -> None:
    (tmp_path / "evaluation.json").write_text("{}")
    one = result(units(1.0), units(2.0))
    with pytest.raises(InvalidInputError, match="of a driving agent"):
        claim(tmp_path, one.benchmark, one.agent)


def test_the_page_shows_every_number_and_escapes_names(tmp_path: Path) -> None:
    text = page(result(units(1.25, 4.0), units(2.0, 8.0), name="<b>mine"))
    assert "&lt;b&gt;mine" in text
    assert "<b>mine" not in text
    for shown in ("1.25", "8.00", "2.62", "persistence", "forecast-hard", "day-1", "-47.5"):
        assert shown in text, shown
    assert "http" not in text.replace("http-equiv", "")
    one = result(units(1.0), units(1.0))
    assert write_page(tmp_path, one).read_text() == page(one)


def test_a_page_says_that_traffic_that_creeps_has_no_rank() -> None:
    benchmark = load_freeway_benchmark("dissipation")
    metrics = (
        Metric("speed_std_mps", "deviation", "m/s", "lower"),
        Metric("throughput_vph", "flow", "veh/h", "higher"),
    )
    creeping = {f"seed-{seed}": {"speed_std_mps": 7.6, "throughput_vph": 3824.0} for seed in range(6)}
    free = {name: {"speed_std_mps": 10.7, "throughput_vph": 5854.0} for name in creeping}
    made = dataclasses.replace(
        result({}, {}), benchmark=benchmark, metrics=metrics, units=creeping, reference_units=free
    )
    assert finding(made).endswith("A run with a throughput of 3824 veh/h, below 5000, has no rank.")
    assert "no rank" not in finding(dataclasses.replace(made, units=free))
