"""`dohyo benchmarks list`: a table from the heads of TOML files alone, or with versions as JSON."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dohyo.evaluation.benchmarks.documents import (
    benchmark_names,
    benchmark_path,
    count_scenarios,
    freeway_benchmark_names,
    freeway_benchmark_path,
    parking_benchmark_names,
    parking_benchmark_path,
    read_document,
)
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.service.cli.output import Json, print_json, print_rows

_OF_A_FREEWAY: dict[str, tuple[str, Callable[[dict[str, Any]], int]]] = {
    "forecast": ("mse", lambda document: document["number"]),
    "traffic": ("speed std", lambda document: len(document["seeds"])),
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
    for name in benchmark_names():
        document = read_document(benchmark_path(name))
        label = Headline(document["headline"]).label
        rows.append((name, str(count_scenarios(document)), label, document["description"]))
    for name in freeway_benchmark_names():
        document = read_document(freeway_benchmark_path(name))
        label, count = _OF_A_FREEWAY[document["kind"]]
        rows.append((name, str(count(document)), label, document["description"]))
    for name in parking_benchmark_names():
        document = read_document(parking_benchmark_path(name))
        rows.append((name, str(document["lots"]), "success", document["description"]))
    study = "Filters on simulated logs, no agent: dohyo localize --study"
    return [*rows, ("localization", "", "share within 0.5 m", study)]


def _with_versions() -> list[dict[str, Any]]:
    """Benchmarks as loaded: a version is a hash of all that a file means, so that this takes longer."""
    return [
        *map(_benchmark, benchmark_names()),
        *map(_freeway_benchmark, freeway_benchmark_names()),
        *map(_parking_benchmark, parking_benchmark_names()),
    ]


def _benchmark(name: str) -> dict[str, Any]:
    from dohyo.evaluation.benchmarks.benchmark import load_benchmark  # builds the models of all events: slow

    benchmark = load_benchmark(name)
    return {
        "name": name,
        "version": benchmark.sha256[:12],
        "cells": len(benchmark.cells),
        "scenarios": benchmark.size,
        "networks": list(benchmark.networks),
        "headline": benchmark.headline.label,
        "metric": benchmark.metric,
        "description": benchmark.description,
    }


def _freeway_benchmark(name: str) -> dict[str, Any]:
    from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, load_freeway_benchmark

    benchmark = load_freeway_benchmark(name)
    return {
        "name": name,
        "version": benchmark.sha256[:12],
        "cells": 1,
        "scenarios": benchmark.number if isinstance(benchmark, ForecastBenchmark) else len(benchmark.seeds),
        "networks": [benchmark.network],
        "headline": benchmark.headline.removesuffix("_mps").replace("_", " "),
        "metric": benchmark.metric,
        "description": benchmark.description,
    }


def _parking_benchmark(name: str) -> dict[str, Any]:
    from dohyo.evaluation.parking.benchmark import load_parking_benchmark

    benchmark = load_parking_benchmark(name)
    return {
        "name": name,
        "version": benchmark.sha256[:12],
        "cells": 1,
        "scenarios": benchmark.lots,
        "networks": [],
        "headline": benchmark.headline,
        "metric": benchmark.metric,
        "description": benchmark.description,
    }
