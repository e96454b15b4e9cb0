"""Benchmarks of parking: lots drawn from held-out seeds, in which one or more karts park."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Literal

from pydantic import Field, ValidationError

from dohyo.evaluation.benchmarks.documents import parking_benchmark_names, parking_benchmark_path
from dohyo.sumo_networks.config import Config, Name
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.scenario import content_hash
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

if TYPE_CHECKING:
    from dohyo.sumo_networks.parking.generate import Scene

MAX_KARTS: Final = 8
"""That of lots, whose module loads numba, which a list of benchmarks does not need."""

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

    @property
    def sha256(self) -> str:
        """Content hash, which is the version. It does not cover the number of lots and texts for people."""
        return content_hash(self.model_dump(mode="json", exclude={"lots", "description", "metric"}))

    @property
    def seeds(self) -> range:
        """Seeds of the lots that are driven by default; no training uses them."""
        return range(HELD_OUT_FROM, HELD_OUT_FROM + self.lots)


def scene_of(name: SceneName) -> Scene:
    """The scene of a name."""
    from dohyo.sumo_networks.parking.generate import Scene  # see MAX_KARTS

    return Scene[name.upper()]


def is_parking_benchmark(name: str) -> bool:
    """Whether a name, or the path of a .toml file, is that of a benchmark of parking."""
    if not name.endswith(".toml"):
        return name in parking_benchmark_names()
    try:
        return tomllib.loads(Path(name).read_text(encoding="utf-8")).get("kind") == "parking"
    except (OSError, ValueError):
        return False  # the function that loads it reports the error


def load_parking_benchmark(name: str) -> ParkingBenchmark:
    """Loads a benchmark of parking by its name, or from the path of a .toml file.

    Raises:
        UnknownNameError: No benchmark has this name.
        InvalidInputError: The file is missing or invalid; the message says where.
    """
    if not name.endswith(".toml") and name not in parking_benchmark_names():
        raise UnknownNameError("benchmark of parking", name, parking_benchmark_names())
    path = Path(name) if name.endswith(".toml") else parking_benchmark_path(name)
    try:
        return ParkingBenchmark.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise InvalidInputError(f"cannot read benchmark file '{path}': {error.strerror}") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        raise InvalidInputError(f"benchmark file '{path}': {where}: {first['msg']}") from error
    except ValueError as error:
        raise InvalidInputError(f"benchmark file '{path}' is not valid TOML: {error}") from error
