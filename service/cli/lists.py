"""`dohyo networks list`, `agents list`, `benchmarks list`. Reads only TOML files and entry points."""

from __future__ import annotations

from typing import Any

from dohyo.agents.registry import agent_views
from dohyo.evaluation.benchmarks.benchmark import benchmark_names, load_benchmark
from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, freeway_benchmark_names, load_freeway_benchmark
from dohyo.service.cli.output import Json, print_json, print_listing, print_rows
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.entries import NetworkSize, builtin_names, network_entry, network_names, network_path


def list_networks(json: Json = False) -> None:
    """Lists the networks that come with dohyo, and those you imported."""
    print_listing([_network(name) for name in network_names()], json)


def list_agents(json: Json = False) -> None:
    """Lists the registered agents."""
    rows = [{"name": name, **view.model_dump(mode="json")} for name, view in agent_views().items()]
    if json:
        print_json(rows)
        return
    print_rows(
        ("name", "track", "control", "sensors"),
        [(row["name"], row["track"], row["control"], ", ".join(row["sensors"])) for row in rows],
    )


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


def _network(name: str) -> dict[str, Any]:
    row: dict[str, Any] = dict.fromkeys(("name", "lanes", "lane_km", "lights", "crossings", "title", "licence", "from"))
    row |= {"name": name, "from": "dohyo" if name in builtin_names() else "you"}
    try:
        entry, size = network_entry(name), _size(name)
    except InvalidInputError as error:
        if row["from"] == "dohyo":
            raise
        # One broken import must not hide the other networks.
        return row | {"title": f"broken: {error}"}
    return row | size.model_dump() | {"title": entry.title, "licence": entry.licence}


def _size(name: str) -> NetworkSize:
    """Size from the catalog entry; imports by an earlier version have none, so their net is read."""
    path, size = network_path(name), network_entry(name).size
    if not path.is_file() or path.stat().st_size == 0:
        raise InvalidInputError(f"'{path}': expected a SUMO net, got {'an empty' if path.is_file() else 'no'} file")
    if size is not None:
        return size
    from dohyo.sumo_networks.networks.catalog import load_network
    from dohyo.sumo_networks.networks.inspection import network_size

    return network_size(load_network(name))


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
