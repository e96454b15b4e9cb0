"""Forecasters as agents of the benchmarks `forecast-easy` and `forecast-hard`: at a service, and in policy workers."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from dohyo.agents.forecasting.base import Forecaster
from dohyo.evaluation.entry import load_entry, make_entry
from dohyo.evaluation.families import FORECASTING_CONTROL, OtherFamilyError
from dohyo.evaluation.settings import OneOf, check_settings
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError

NAME: Final = "forecaster"
"""Registered name of the shipped forecasters."""
HISTORY_SENSOR: Final = "history"
CLOCK_SENSOR: Final = "time_of_day"
MODELS: Final = (
    "persistence",
    "historical-mean",
    "linear",
    "sa-lstm",
    "sa-lstm-n-step",
    "sa-lstm-quantiles",
    "tsmixer",
)
"""Names of `ShippedForecaster`: persistence, and the checkpoints."""


class ForecasterSpec(Config):
    """Specification of a forecaster.

    Attributes:
        name: Name of the agent, for people and file names.
        sensors: What it sees: always the history; with `time_of_day`, also the clock.
    """

    name: str
    sensors: tuple[str, ...] = (HISTORY_SENSOR, CLOCK_SENSOR)

    @property
    def track(self) -> Literal["sensors"]:
        """Track, for records."""
        return "sensors"

    @property
    def control(self) -> str:
        """What the agent answers, for records."""
        return FORECASTING_CONTROL


class ForecastAgent(Protocol):
    """A forecaster of the speeds of a road's segments.

    Attributes:
        spec: Specification of the agent, known before the first day.
    """

    spec: ForecasterSpec

    def reset(self, seed: int) -> None:
        """Prepares for a day; all randomness must follow from the seed."""

    def act(self, observation: Mapping[str, np.ndarray]) -> ArrayLike:
        """Forecasts once a minute.

        Args:
            observation: `history`: (8, N) speeds of the last minutes without gaps, the oldest first, m/s; and, where
                the spec names it, `time_of_day`: (1,) of the last row, s.

        Returns:
            (3, N) speeds of the next three minutes, m/s.
        """
        ...

    def close(self) -> None:
        """Frees the resources of the agent."""


class ForecasterAgent:
    """A `Forecaster` as an agent.

    Attributes:
        spec: See `ForecastAgent`.
        forecaster: The forecaster.
    """

    def __init__(self, name: str, forecaster: Forecaster) -> None:
        self.spec, self.forecaster = ForecasterSpec(name=name), forecaster

    def reset(self, seed: int) -> None:
        """See `ForecastAgent`."""

    def act(self, observation: Mapping[str, np.ndarray]) -> ArrayLike:
        """See `ForecastAgent`."""
        return self.forecaster.predict(observation[HISTORY_SENSOR], float(observation[CLOCK_SENSOR][0]))

    def close(self) -> None:
        """See `ForecastAgent`."""


class ShippedForecaster(ForecasterAgent):
    """A forecaster that ships with dohyo.

    Attributes:
        files: Its weights, whose digest records state.
    """

    def __init__(self, model: Annotated[str, OneOf(MODELS)] = "sa-lstm-n-step", exported: bool = False) -> None:
        """Reads the weights.

        Args:
            model: Name of the forecaster.
            exported: Run the ONNX file, as a car would, and not the network in torch.

        Raises:
            InvalidInputError: The forecaster has no ONNX file.
        """
        from dohyo.agents.forecasting.registry import CHECKPOINTS, load_forecaster, make_forecaster  # loads torch

        if model == "persistence":
            super().__init__(model, make_forecaster(model, segments()))
            self.files: tuple[Path, ...] = ()
            return
        super().__init__(model, load_forecaster(model, exported=exported))
        self.files = (CHECKPOINTS / f"{model}{'.onnx' if exported else '.safetensors'}",)


class OwnForecaster(ForecasterAgent):
    """A forecaster of a user's own class.

    Attributes:
        inner: The forecaster, whose sources are part of the agent's.
    """

    def __init__(self, forecaster: Forecaster) -> None:
        super().__init__(forecaster.name, forecaster)
        self.inner = forecaster


def make_forecast_agent(entry: str, settings: Mapping[str, Any] | None = None) -> ForecastAgent:
    """Makes an agent from "module:Class" and settings; the class is a `Forecaster` or a `ForecasterAgent`.

    Raises:
        InvalidInputError: The module or class is missing, or its constructor fails.
        OtherFamilyError: It does not forecast.
        SettingsError: Settings are unknown, of another type, or out of range.
    """
    made, given = load_entry(entry, "agent"), settings or {}
    if isinstance(made, type) and issubclass(made, Forecaster):
        return OwnForecaster(_own(entry, made, given))
    if not (isinstance(made, type) and issubclass(made, ForecasterAgent)):
        raise OtherFamilyError(f"agent '{entry}' is no forecaster")
    agent: ForecastAgent = make_entry(entry, "agent", given)
    return agent


def segments() -> int:
    """Number of segments of the road of the benchmarks, N."""
    from dohyo.sumo_networks.freeway.road import load_freeway  # reads the network

    return load_freeway().segments


def _own(entry: str, kind: type[Forecaster], settings: Mapping[str, Any]) -> Forecaster:
    maker = partial(kind, segments(), 60.0)
    check_settings(maker, f"forecaster '{entry}'", settings)
    try:
        return maker(**settings)
    except Exception as error:  # a foreign constructor may raise anything
        raise InvalidInputError(f"forecaster '{entry}' cannot be made: {type(error).__name__}: {error}") from error
