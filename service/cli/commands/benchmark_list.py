"""`dohyo benchmarks list`: a table from the heads of TOML files alone, or with versions as JSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from dohyo.evaluation.benchmarks.documents import (
    benchmark_names,
    benchmark_path,
    count_scenarios,
    read_document,
)
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.families import Family
from dohyo.service.cli.output import Json, print_json, print_rows

if TYPE_CHECKING:
    from dohyo.evaluation.benchmarks.benchmark import Benchmark
    from dohyo.evaluation.freeway.benchmark import FreewayBenchmark
    from dohyo.evaluation.parking.benchmark import ParkingBenchmark

_RANKED_BY: dict[str, tuple[str, Callable[[dict[str, Any]], int]]] = {
    "forecast": ("mse", lambda document: document["number"]),
    "traffic": ("speed std", lambda document: len(document["seeds"])),
    "parking": ("success", lambda document: document["lots"]),
}
"""Headline, and function from the document to the number of scenarios, by kind."""


def list_benchmarks(json: Json = False) -> None:
    """Lists the benchmarks."""
    if json:
        print_json(_with_versions())
        return
    print_rows(("name", "scenarios", "ranked by", "description"), table_rows())


def table_rows() -> list[tuple[str, str, str, str]]:
    """Name, number of scenarios, headline and description of all benchmarks."""
    rows = []
    for family in Family:
        for name in benchmark_names(family):
            document = read_document(benchmark_path(name, family))
            label, count = _headline_and_count(document)
            rows.append((name, str(count), label, document["description"]))
    study = "Filters on simulated logs, no agent: dohyo localize --study"
    return [*rows, ("localization", "", "share within 0.5 m", study)]


def _headline_and_count(document: dict[str, Any]) -> tuple[str, int]:
    """Name of the headline, and number of scenarios."""
    if "kind" not in document:
        return Headline(document["headline"]).label, count_scenarios(document)
    label, count = _RANKED_BY[document["kind"]]
    return label, count(document)


def _with_versions() -> list[dict[str, Any]]:
    """Benchmarks as loaded: a version is a hash of all that a file means, so that this takes longer."""
    load = {Family.DRIVING: _driving, Family.FREEWAY: _freeway, Family.PARKING: _parking, Family.FORECASTING: _freeway}
    return [load[family](name) for family in Family for name in benchmark_names(family)]


def _driving(name: str) -> dict[str, Any]:
    from dohyo.evaluation.benchmarks.benchmark import load_benchmark  # builds the models of all events: slow

    benchmark = load_benchmark(name)
    headline = benchmark.headline.label
    return _entry(benchmark, headline, benchmark.size, len(benchmark.cells), benchmark.networks)


def _freeway(name: str) -> dict[str, Any]:
    from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, load_freeway_benchmark

    benchmark = load_freeway_benchmark(name)
    scenarios = benchmark.number if isinstance(benchmark, ForecastBenchmark) else len(benchmark.seeds)
    headline = benchmark.headline.removesuffix("_mps").replace("_", " ")
    return _entry(benchmark, headline, scenarios, networks=[benchmark.network])


def _parking(name: str) -> dict[str, Any]:
    from dohyo.evaluation.parking.benchmark import load_parking_benchmark

    benchmark = load_parking_benchmark(name)
    return _entry(benchmark, benchmark.headline, benchmark.lots)


def _entry(
    benchmark: Benchmark | FreewayBenchmark | ParkingBenchmark,
    headline: str,
    scenarios: int,
    cells: int = 1,
    networks: Sequence[str] = (),
) -> dict[str, Any]:
    return {
        "name": benchmark.name,
        "version": benchmark.sha256[:12],
        "cells": cells,
        "scenarios": scenarios,
        "networks": list(networks),
        "headline": headline,
        "metric": benchmark.metric,
        "description": benchmark.description,
    }
