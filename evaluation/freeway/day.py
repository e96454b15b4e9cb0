"""Days of a forecast benchmark: the scenario of one day, and the record of one forecaster on it.

Once a minute the forecaster gets the speeds of the last eight minutes and answers those of the next three.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Final

import numpy as np
from pydantic import Field

from dohyo.evaluation.freeway.benchmark import ForecastBenchmark
from dohyo.evaluation.freeway.records import FreewayRecord, facts_at
from dohyo.evaluation.freeway.result import Metric
from dohyo.evaluation.running.manifest import ResultManifest
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.ego.control import InvalidActionError

DAY: Final = "day"
FORECASTER: Final = "forecaster"
MINUTES: Final = 3
"""Minutes ahead that are forecast."""
FASTEST_MPS: Final = 60.0
"""Largest speed of a forecast, m/s."""

METRICS: Final = (
    Metric("mse", "MSE of normalised speed, mean of three minutes", "x 10^3", "lower"),
    *(Metric(f"mse_{row}", f"the same, t+{row} min", "x 10^3", "lower") for row in range(1, MINUTES + 1)),
    *(Metric(f"rmse_{row}", f"RMSE, t+{row} min", "km/h", "lower", root=True) for row in range(1, MINUTES + 1)),
    Metric("mse_true", "MSE against the speed of all vehicles", "x 10^3", "lower"),
)
"""Measures of a day, the headline first; `rmse_1` to `rmse_3` of one day are squares, km^2/h^2."""


class DayScenario(Config):
    """One day: everything that is needed to make it again.

    Attributes:
        benchmark: Kind of the days.
        seed: Seed of the days.
        number: Number of the day, from 1.
    """

    cell: ClassVar[str] = DAY

    benchmark: ForecastBenchmark
    seed: Annotated[int, Field(ge=0)]
    number: Annotated[int, Field(ge=1)]

    @property
    def name(self) -> str:
        """Name of the day among those of a seed."""
        return f"{DAY}-{self.number:04}"


class DayRecord(FreewayRecord):
    """The facts of one forecaster on one day.

    Attributes:
        scenario: Day that was forecast.
        measures: Errors by the keys of `METRICS`, `rmse_1` to `rmse_3` squared, km^2/h^2; none after a failure.
        forecasts: Number of forecasts that the forecaster made.
        forecasts_sha256: Hash of all forecasts, float32 (forecasts, 3, N), m/s; "" after a failure.
        versions: Versions of dohyo and SUMO, and the hash of the network.
    """

    what: ClassVar[str] = "the record of a day of forecasts"

    scenario: DayScenario
    measures: Mapping[str, float] = Field(default_factory=dict)
    forecasts: int = 0
    forecasts_sha256: str = ""
    versions: Mapping[str, str] = Field(default_factory=dict)


def check_forecast(given: object, shape: tuple[int, ...]) -> FloatArray:
    """A forecast, each speed moved into 0 to `FASTEST_MPS`.

    Args:
        given: What the forecaster answered, m/s.
        shape: (3, N) expected shape.

    Raises:
        InvalidActionError: Another shape, or a speed that is not finite.
    """
    try:
        speeds = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidActionError(f"expected a forecast of {shape} speeds, got {type(given).__name__}") from error
    if speeds.shape != shape:
        raise InvalidActionError(f"expected a forecast of shape {shape}, got {speeds.shape}")
    if not np.isfinite(speeds).all():
        raise InvalidActionError("expected a forecast of finite speeds, got NaN or infinity")
    return np.clip(speeds, 0.0, FASTEST_MPS)


def is_day(path: Path) -> bool:
    """Whether a file looks like the record of a day of forecasts.

    Raises:
        InvalidInputError: The file is missing or too large.
    """
    return "forecasts_sha256" in facts_at(path)


class DaysManifest(ResultManifest):
    """Description of a result folder of days."""

    benchmark: ForecastBenchmark
