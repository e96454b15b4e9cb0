"""Benchmarks by name and from their stored documents: of drives, of parking lots, and of freeway mornings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.benchmarks.documents import benchmark_names
from dohyo.evaluation.families import Family, OtherFamilyError, check_family
from dohyo.evaluation.freeway.benchmark import TrafficBenchmark, load_freeway_benchmark
from dohyo.evaluation.freeway.morning import MorningScenario
from dohyo.evaluation.parking.benchmark import LotScenario, ParkingBenchmark, load_parking_benchmark
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.scenario import Scenario

AnyBenchmark = Benchmark | TrafficBenchmark | ParkingBenchmark
AnyScenario = Scenario | MorningScenario | LotScenario


def family_of(benchmark: AnyBenchmark) -> Family:
    """Family of a benchmark."""
    match benchmark:
        case Benchmark():
            return Family.DRIVING
        case ParkingBenchmark():
            return Family.PARKING
        case TrafficBenchmark():
            return Family.FREEWAY


def check_agent(info: Mapping[str, Any], benchmark: AnyBenchmark) -> None:
    """Checks that a submission is for a benchmark.

    Raises:
        InvalidInputError: It is for another family of benchmarks.
    """
    try:
        check_family(info["name"], info["control"], family_of(benchmark))
    except OtherFamilyError as error:
        raise InvalidInputError(f"benchmark '{benchmark.name}': {error}") from error


def offered_benchmarks() -> list[AnyBenchmark]:
    """All benchmarks that this service evaluates."""
    return [find_benchmark(name) for name in _names()]


def find_benchmark(name: str) -> AnyBenchmark:
    """A benchmark of the catalog by its name; a name is never used as a path.

    Raises:
        UnknownNameError: There is none, or the service does not evaluate it.
    """
    if name in benchmark_names(Family.DRIVING):
        return load_benchmark(name)
    if name in benchmark_names(Family.PARKING):
        return load_parking_benchmark(name)
    if name in benchmark_names(Family.FREEWAY):
        found = load_freeway_benchmark(name)
        if isinstance(found, TrafficBenchmark):
            return found
    raise UnknownNameError("benchmark", name, _names())


def read_benchmark(document: Mapping[str, Any]) -> AnyBenchmark:
    """A benchmark from its stored document."""
    if document.get("kind") == "traffic":
        return TrafficBenchmark.model_validate(document)
    if document.get("kind") == "parking":
        return ParkingBenchmark.model_validate(document)
    return Benchmark.model_validate(document)


def _names() -> list[str]:
    freeway = [
        name for name in benchmark_names(Family.FREEWAY) if isinstance(load_freeway_benchmark(name), TrafficBenchmark)
    ]
    return [*benchmark_names(Family.DRIVING), *benchmark_names(Family.PARKING), *freeway]
