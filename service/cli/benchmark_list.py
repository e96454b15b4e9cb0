"""`dohyo benchmarks list`, from TOML files alone."""

from __future__ import annotations

from typing import Any

from dohyo.evaluation.benchmarks.benchmark import benchmark_names, load_benchmark
from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, freeway_benchmark_names, load_freeway_benchmark
from dohyo.service.cli.output import Json, print_json, print_rows


def list_benchmarks(json: Json = False) -> None:
    """Lists the benchmarks."""
    rows = [*map(_benchmark, benchmark_names()), *map(_freeway_benchmark, freeway_benchmark_names())]
    if json:
        print_json(rows)
        return
    print_rows(
        ("name", "scenarios", "ranked by", "description"),
        [
            *((row["name"], str(row["scenarios"]), row["headline"], row["description"]) for row in rows),
            ("localization", "", "share within 0.5 m", "Filters on simulated logs, no agent: dohyo localize --study"),
        ],
    )


def _benchmark(name: str) -> dict[str, Any]:
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
    benchmark = load_freeway_benchmark(name)
    return {
        "name": name,
        "version": benchmark.sha256[:12],
        "cells": 1,
        "scenarios": benchmark.number if isinstance(benchmark, ForecastBenchmark) else len(benchmark.seeds),
        "networks": [benchmark.network],
        "headline": benchmark.headline.replace("_", " "),
        "metric": benchmark.metric,
        "description": benchmark.description,
    }
