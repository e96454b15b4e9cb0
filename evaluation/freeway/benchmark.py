"""Benchmarks of the freeway: speeds to forecast, and traffic to even out. No car is driven by an agent in them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, TypeAdapter, ValidationError

from dohyo.evaluation.benchmarks.benchmark import BENCHMARKS
from dohyo.sumo_networks.config import Config, Name
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.networks.entries import user_catalog
from dohyo.sumo_networks.scenario import content_hash

if TYPE_CHECKING:
    from dohyo.sumo_networks.freeway.dataset import DatasetRequest

FREEWAY_BENCHMARKS = BENCHMARKS / "freeway"


class _Named(Config):
    """What both kinds have.

    Attributes:
        name: In the catalog.
        description: One line for people.
        headline: Name of the number that ranks.
        metric: For people: how that number is computed.
        network: A freeway of the network catalog.
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
    """Days of segment speeds, of which the next rows are to be forecast from the last ones.

    Attributes:
        days: Whole days in meso (easy), or mornings of dense congestion in micro (hard).
        number: How many.
        seed: Of the days; other sets of the same seed are other days.
        probes: Share of the vehicles whose speed is reported.
        free_kmh: What a normalised speed of 1 is.
    """

    headline = "mse"

    kind: Literal["forecast"]
    days: Literal["easy", "hard"]
    number: Annotated[int, Field(ge=1, le=9999)]
    seed: Annotated[int, Field(ge=0)]
    probes: Annotated[float, Field(gt=0, le=1)] = 0.15
    free_kmh: Annotated[float, Field(gt=0)]

    @property
    def order(self) -> DatasetRequest:
        """What `freeway.dataset.make_dataset` makes of it."""
        from dohyo.sumo_networks.freeway.dataset import DatasetRequest  # imports SUMO; a list of names must not

        numbers = {"easy": 0, "hard": 0, self.days: self.number}
        return DatasetRequest(days=0, seed=self.seed, probes=self.probes, network=self.network, **numbers)


class TrafficBenchmark(_Named):
    """Mornings whose traffic a controller of connected cars is to make even, one for each seed.

    Attributes:
        start_s: Time of day at which control and measurement begin.
        duration_s: Of both.
        warm_up_s: Before the feed of segment speeds begins.
        penetration: Share of connected cars.
        seeds: Driven by default.
    """

    headline = "speed_std"

    kind: Literal["traffic"]
    start_s: Annotated[float, Field(ge=0, lt=86400)]
    duration_s: Annotated[float, Field(gt=0, le=86400)]
    warm_up_s: Annotated[float, Field(ge=0)]
    penetration: Annotated[float, Field(ge=0, le=1)]
    seeds: Annotated[tuple[int, ...], Field(min_length=1)]


FreewayBenchmark = ForecastBenchmark | TrafficBenchmark
_READ: TypeAdapter[FreewayBenchmark] = TypeAdapter(Annotated[FreewayBenchmark, Field(discriminator="kind")])


def freeway_benchmark_names() -> list[str]:
    """Names of the benchmarks of the freeway that come with dohyo, sorted."""
    return sorted(path.stem for path in FREEWAY_BENCHMARKS.glob("*.toml"))


def is_freeway_benchmark(name: str) -> bool:
    """Whether a name, or the path of a .toml file, is of the freeway."""
    if not name.endswith(".toml"):
        return name in freeway_benchmark_names()
    try:
        return "kind" in tomllib.loads(Path(name).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False  # whoever reads it next says what is wrong


def load_freeway_benchmark(name: str) -> FreewayBenchmark:
    """A benchmark of the freeway by name, or from a path of a .toml file.

    Raises:
        UnknownNameError: No such name.
        InvalidInputError: The file is missing or broken; the message says where.
    """
    if not name.endswith(".toml") and name not in freeway_benchmark_names():
        raise UnknownNameError("benchmark of the freeway", name, freeway_benchmark_names())
    path = Path(name) if name.endswith(".toml") else FREEWAY_BENCHMARKS / f"{name}.toml"
    try:
        return _READ.validate_python(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise InvalidInputError(f"cannot read benchmark file '{path}': {error.strerror}") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        raise InvalidInputError(f"benchmark file '{path}': {where}: {first['msg']}") from error
    except ValueError as error:
        raise InvalidInputError(f"benchmark file '{path}' is no TOML: {error}") from error


def days_folder(benchmark: ForecastBenchmark) -> Path:
    """Where a benchmark's days are kept once they are made: $DOHYO_HOME/freeway, else in the user's data folder.

    Days of another SUMO or another version of dohyo lie elsewhere, so that an update never mixes them.
    """
    from dohyo.sumo_networks.freeway.dataset import dataset_facts

    return user_catalog().with_name("freeway") / content_hash(dataset_facts(benchmark.order))[:16]
