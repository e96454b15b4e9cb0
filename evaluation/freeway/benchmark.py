"""Benchmarks of the freeway: forecasts of speeds, and control of traffic. No agent drives a car in them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from dohyo.evaluation.benchmarks.documents import find_family
from dohyo.evaluation.benchmarks.loading import load
from dohyo.evaluation.families import Family
from dohyo.sumo_networks.config import Config, Name
from dohyo.sumo_networks.networks.entries import user_catalog
from dohyo.sumo_networks.scenario import content_hash

if TYPE_CHECKING:
    from dohyo.evaluation.freeway.day import DayScenario
    from dohyo.evaluation.freeway.morning import MorningScenario
    from dohyo.sumo_networks.freeway.dataset import DatasetRequest


class _Named(Config):
    """Common fields of both kinds of benchmark.

    Attributes:
        name: Name in the catalog.
        description: Description in one line, for people.
        headline: Name of the metric that ranks.
        metric: Computation of that metric in words, for people.
        network: Name of a freeway in the network catalog.
    """

    headline: ClassVar[str]

    name: Name
    description: str
    metric: str
    network: str = "freeway"

    @property
    def sha256(self) -> str:
        """Content hash: its version. Default seeds and the description are no part of it."""
        return content_hash(self.model_dump(mode="json", exclude={"seeds", "description"}))


class ForecastBenchmark(_Named):
    """Days of segment speeds; the task is to forecast the next rows from the last rows.

    Attributes:
        days: Kind of days: whole days in meso (easy), or mornings of dense congestion in micro (hard).
        number: Number of days.
        seed: Seed of the days by default; different sets with the same seed have different days.
        probes: Share of the vehicles that report their speed, in [0, 1].
        free_kmh: Speed that is normalised to 1, km/h.
    """

    headline = "mse"

    kind: Literal["forecast"]
    days: Literal["easy", "hard"]
    number: Annotated[int, Field(ge=1, le=9999)]
    seed: Annotated[int, Field(ge=0)]
    probes: Annotated[float, Field(gt=0, le=1)] = 0.15
    free_kmh: Annotated[float, Field(gt=0)]

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seed of the days that are forecast by default."""
        return (self.seed,)

    @property
    def size(self) -> int:
        """Number of days per seed."""
        return self.number

    def scenarios(self, seeds: Sequence[int] | None = None) -> tuple[DayScenario, ...]:
        """All days of each seed; None: of the default seed."""
        from dohyo.evaluation.freeway.day import DayScenario

        numbers = range(1, self.number + 1)
        given = self.seeds if seeds is None else seeds
        return tuple(DayScenario(benchmark=self, seed=seed, number=number) for seed in given for number in numbers)

    @property
    def order(self) -> DatasetRequest:
        """Configuration of the days for `freeway.dataset.make_dataset`."""
        from dohyo.sumo_networks.freeway.dataset import DatasetRequest  # imports SUMO: slow

        numbers = {"easy": 0, "hard": 0, self.days: self.number}
        return DatasetRequest(days=0, seed=self.seed, probes=self.probes, network=self.network, **numbers)


class TrafficBenchmark(_Named):
    """Mornings in which a controller of connected cars smooths the traffic, one for each seed.

    Attributes:
        network: The freeway of this task, whose bottleneck and buffer are known.
        start_s: Time of day at which control and measurement begin, s; the feed begins 12 minutes before.
        duration_s: Duration of control and measurement, s.
        warm_up_s: Simulated time before the feed of segment speeds begins, s.
        penetration: Share of connected cars, in [0, 1].
        least_throughput_vph: Mean throughput past the bottleneck below which a run has no rank: traffic that creeps is
            even. Vehicles/h; 0: any has one.
        seeds: Seeds that are driven by default.
    """

    headline = "speed_std_mps"

    kind: Literal["traffic"]
    network: Literal["freeway"] = "freeway"
    start_s: Annotated[float, Field(ge=720, lt=86400)]
    duration_s: Annotated[float, Field(gt=0, le=86400)]
    warm_up_s: Annotated[float, Field(ge=0)]
    penetration: Annotated[float, Field(ge=0, le=1)]
    least_throughput_vph: Annotated[float, Field(ge=0, exclude_if=lambda least: least == 0.0)] = 0.0
    seeds: Annotated[tuple[int, ...], Field(min_length=1)]

    @property
    def size(self) -> int:
        """Number of mornings per seed."""
        return 1

    def scenarios(self, seeds: Sequence[int] | None = None) -> tuple[MorningScenario, ...]:
        """One morning for each seed; None: for the default seeds."""
        from dohyo.evaluation.freeway.morning import MorningScenario

        return tuple(MorningScenario(benchmark=self, seed=seed) for seed in (self.seeds if seeds is None else seeds))


FreewayBenchmark = ForecastBenchmark | TrafficBenchmark


def load_freeway_benchmark(name: str) -> FreewayBenchmark:
    """Loads a benchmark on the freeway by its name, or from the path of a .toml file.

    Raises:
        UnknownNameError: No benchmark has this name.
        InvalidInputError: The file is missing or invalid; the message says where.
    """
    return load_forecasting(name) if find_family(name) is Family.FORECASTING else load_traffic(name)


def load_forecasting(name: str) -> ForecastBenchmark:
    """Loads a benchmark of forecasts; errors as of `load_freeway_benchmark`."""
    return load(name, Family.FORECASTING, ForecastBenchmark)


def load_traffic(name: str) -> TrafficBenchmark:
    """Loads a benchmark of mornings; errors as of `load_freeway_benchmark`."""
    return load(name, Family.FREEWAY, TrafficBenchmark)


def days_folder(benchmark: ForecastBenchmark) -> Path:
    """Folder of a benchmark's days once they are made: in $DOHYO_HOME/freeway, else in the user's data folder.

    Another version of SUMO or of dohyo has another folder, so that an update never mixes days.
    """
    from dohyo.sumo_networks.freeway.dataset import dataset_facts

    return user_catalog().with_name("freeway") / content_hash(dataset_facts(benchmark.order))[:16]
