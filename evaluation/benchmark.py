"""Benchmark: a versioned list of scenarios with its scoring, read from TOML."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError, model_validator

from sumo_networks.catalog import load_network
from sumo_networks.errors import InvalidInputError, UnknownNameError
from sumo_networks.routing import plan_route
from sumo_networks.scenario import Config, Mission, Scenario, Traffic, content_hash

BENCHMARKS = Path(__file__).with_name("benchmarks")


class Benchmark(Config):
    """A versioned list of scenarios.

    Attributes:
        name: In the catalog.
        description: One line for people.
        metric: Exactly what the headline number is.
        rules: Of the driving score.
        network: Name in the network catalog.
        traffic: Around every mission.
        missions: Each one scenario, driven by a single ego.
        stop_on_collision: As in NoCrash.
        time_limit_s: None: from the route.
        seeds: Driven by default.
    """

    name: str
    description: str
    metric: str
    rules: Literal["1.0", "2.0", "2.1"] = "2.0"
    network: str
    traffic: Traffic = Traffic()
    missions: Annotated[tuple[Mission, ...], Field(min_length=1)]
    stop_on_collision: bool = False
    time_limit_s: Annotated[float, Field(gt=0)] | None = None
    seeds: Annotated[tuple[int, ...], Field(min_length=1)] = (0, 1, 2)

    @model_validator(mode="after")
    def _names_are_unique(self) -> Benchmark:
        names = [mission.name for mission in self.missions]
        if len(set(names)) != len(names):
            raise ValueError(f"mission names must be unique, got {names}")
        return self

    @cached_property
    def sha256(self) -> str:
        """Content hash: its version. The default seeds are no part of it."""
        return content_hash(self.model_dump(mode="json", exclude={"seeds", "description"}))

    def scenarios(self, seeds: Sequence[int]) -> list[Scenario]:
        """One scenario per mission and seed, seed by seed."""
        return [
            Scenario(
                name=mission.name,
                network=self.network,
                missions=(mission.model_copy(update={"name": "ego"}),),
                traffic=self.traffic,
                stop_on_collision=self.stop_on_collision,
                time_limit_s=self.time_limit_s,
                seed=seed,
            )
            for seed in seeds
            for mission in self.missions
        ]

    def check(self) -> None:
        """Plans every mission once.

        Raises:
            InvalidInputError: A mission cannot be driven; the message says which.
        """
        network = load_network(self.network)
        for number, mission in enumerate(self.missions, start=1):
            try:
                plan_route(network, mission)
            except InvalidInputError as error:
                raise InvalidInputError(f"benchmark '{self.name}', mission {number}: {error}") from error


def benchmark_names() -> list[str]:
    """Names of the benchmarks that come with dohyo, sorted."""
    return sorted(path.stem for path in BENCHMARKS.glob("*.toml"))


def load_benchmark(name: str) -> Benchmark:
    """A benchmark by name, or from a path of a .toml file.

    Raises:
        UnknownNameError: No such name.
        InvalidInputError: The file is missing or broken; the message says where.
    """
    path = Path(name) if name.endswith(".toml") else BENCHMARKS / f"{name}.toml"
    if not name.endswith(".toml") and name not in benchmark_names():
        raise UnknownNameError("benchmark", name, benchmark_names())
    try:
        return Benchmark.model_validate(tomllib.loads(path.read_text()))
    except OSError as error:
        raise InvalidInputError(f"cannot read benchmark file '{path}': {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"benchmark file '{path}' is no TOML: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InvalidInputError(f"benchmark file '{path}': {where or 'file'}: {first['msg']}") from error
