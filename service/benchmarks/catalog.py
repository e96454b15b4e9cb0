"""Benchmarks by name and from their stored documents: of drives, parking lots, freeway mornings, and forecasts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.benchmarks.documents import benchmark_names
from dohyo.evaluation.families import Family, OtherFamilyError, check_family
from dohyo.evaluation.freeway.benchmark import ForecastBenchmark, TrafficBenchmark, load_forecasting, load_traffic
from dohyo.evaluation.freeway.day import DayScenario
from dohyo.evaluation.freeway.morning import MorningScenario
from dohyo.evaluation.parking.benchmark import LotScenario, ParkingBenchmark, load_parking_benchmark
from dohyo.service.benchmarks.own import load_own, own_benchmarks, own_names
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.scenario import Scenario

AnyBenchmark = Benchmark | TrafficBenchmark | ParkingBenchmark | ForecastBenchmark
AnyScenario = Scenario | MorningScenario | LotScenario | DayScenario

_LOADERS: Final[Mapping[Family, Callable[[str], AnyBenchmark]]] = {
    Family.DRIVING: load_benchmark,
    Family.PARKING: load_parking_benchmark,
    Family.FREEWAY: load_traffic,
    Family.FORECASTING: load_forecasting,
}
_KINDS: Final[Mapping[str, type[TrafficBenchmark | ParkingBenchmark | ForecastBenchmark]]] = {
    "traffic": TrafficBenchmark,
    "parking": ParkingBenchmark,
    "forecast": ForecastBenchmark,
}
"""Type of a document by its `kind`; documents without it are of drives."""


def family_of(benchmark: AnyBenchmark) -> Family:
    """Family of a benchmark."""
    match benchmark:
        case Benchmark():
            return Family.DRIVING
        case ParkingBenchmark():
            return Family.PARKING
        case TrafficBenchmark():
            return Family.FREEWAY
        case ForecastBenchmark():
            return Family.FORECASTING


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
    """All benchmarks that this service evaluates: those that ship with dohyo, and its organiser's own."""
    return [*(find_benchmark(name) for name in _shipped()), *own_benchmarks()]


def find_benchmark(name: str) -> AnyBenchmark:
    """A benchmark of the catalog by its name; a name is never used as a path.

    Raises:
        UnknownNameError: There is none.
        InvalidInputError: It is the organiser's own, and its file is faulty.
    """
    for family, load in _LOADERS.items():
        if name in benchmark_names(family):
            return load(name)
    if name in own_names():
        return load_own(name)
    raise UnknownNameError("benchmark", name, [*_shipped(), *own_names()])


def read_benchmark(document: Mapping[str, Any]) -> AnyBenchmark:
    """A benchmark from its stored document."""
    return _KINDS.get(str(document.get("kind")), Benchmark).model_validate(document)


def _shipped() -> list[str]:
    return [name for family in _LOADERS for name in benchmark_names(family)]
