"""Benchmarks of parking: lots drawn from held-out seeds, in which one or more karts park."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Literal

from pydantic import Field, model_validator

from dohyo.evaluation.benchmarks.loading import load
from dohyo.evaluation.families import Family
from dohyo.sumo_networks.config import Config, Name
from dohyo.sumo_networks.parking.limits import MAX_KARTS, most_karts
from dohyo.sumo_networks.scenario import content_hash
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

if TYPE_CHECKING:
    from dohyo.sumo_networks.parking.generate import Scene

LOT: Final = "lot"

SceneName = Literal["simple", "complex", "parallel", "angled", "pedestrians"]


class ParkingBenchmark(Config):
    """Lots of one scene, drawn from held-out seeds.

    Attributes:
        kind: Always "parking".
        name: Name in the catalog.
        description: Description in one line, for people.
        metric: Computation of the success rate in words, for people.
        scene: Kind of lot.
        karts: Karts in each lot.
        lots: Number of lots that are driven by default.
    """

    headline: ClassVar[str] = "success"

    kind: Literal["parking"]
    name: Name
    description: str
    metric: str
    scene: SceneName
    karts: Annotated[int, Field(ge=1, le=MAX_KARTS)] = 1
    lots: Annotated[int, Field(ge=1, le=100_000)] = 2000

    @model_validator(mode="after")
    def _spots_for_all(self) -> ParkingBenchmark:
        if self.karts > (most := most_karts(self.scene)):
            raise ValueError(f"expected at most {most} karts in the scene '{self.scene}', got {self.karts}")
        return self

    @property
    def sha256(self) -> str:
        """Content hash, which is the version. It does not cover the number of lots and texts for people."""
        return content_hash(self.model_dump(mode="json", exclude={"lots", "description", "metric"}))

    @property
    def seeds(self) -> range:
        """Seeds of the lots that are driven by default; no training uses them."""
        return range(HELD_OUT_FROM, HELD_OUT_FROM + self.lots)

    @property
    def size(self) -> int:
        """Number of lots per seed."""
        return 1

    def scenarios(self, seeds: Sequence[int] | None = None) -> tuple[LotScenario, ...]:
        """One lot for each seed; None: for the default seeds."""
        return tuple(LotScenario(benchmark=self, seed=seed) for seed in (self.seeds if seeds is None else seeds))


class LotScenario(Config):
    """One lot: everything that is needed to draw it again.

    Attributes:
        benchmark: Scene, and number of karts.
        seed: Seed of the lot.
    """

    name: ClassVar[str] = LOT
    cell: ClassVar[str] = LOT

    benchmark: ParkingBenchmark
    seed: int


def scene_of(name: SceneName) -> Scene:
    """The scene of a name."""
    from dohyo.sumo_networks.parking.generate import Scene  # loads numba, which a list of benchmarks does not need

    return Scene[name.upper()]


def load_parking_benchmark(name: str) -> ParkingBenchmark:
    """Loads a benchmark of parking by its name, or from the path of a .toml file.

    Raises:
        UnknownNameError: No benchmark has this name.
        InvalidInputError: The file is missing or invalid; the message says where.
    """
    return load(name, Family.PARKING, ParkingBenchmark)
