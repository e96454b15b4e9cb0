"""The interface of a forecaster: what a policy or a worker sees and answers once a minute of a day."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, Final

from dohyo.agents.forecasting.agent import CLOCK_SENSOR, HISTORY_SENSOR, segments
from dohyo.evaluation.families import FORECASTING_CONTROL
from dohyo.sumo_networks.errors import InvalidInputError

TRACK: Final = "sensors"
SENSORS: Final = (HISTORY_SENSOR, CLOCK_SENSOR)
"""A forecaster has the first of these, or both."""
POLICY: Final = "dohyo.service.forecasting.policy:OnnxForecaster"
"""Entry of an uploaded policy that forecasts."""
OUTPUT: Final = "forecast"
"""Output of an ONNX policy, as `dohyo forecast fit` exports it."""
MINUTES_SEEN: Final = 8
MINUTES_AHEAD: Final = 3
DECIDES_EVERY_S: Final = 60.0
"""Simulated time between two forecasts, s."""


def check_forecaster(track: str, sensors: Sequence[str]) -> None:
    """Checks the declaration of a forecaster.

    Raises:
        InvalidInputError: It has another track, or other sensors.
    """
    if track != TRACK or tuple(sensors) not in (SENSORS[:1], SENSORS):
        raise InvalidInputError(
            f"control '{FORECASTING_CONTROL}' is that of a forecaster: expected track '{TRACK}' and the sensors "
            f"{list(SENSORS[:1])} or {list(SENSORS)}, got track '{track}' and {list(sensors)}"
        )


def history_shape() -> tuple[int, int]:
    """(8, N) of what a forecaster sees."""
    return MINUTES_SEEN, _segments()


def forecast_shape() -> tuple[int, int]:
    """(3, N) of a forecast."""
    return MINUTES_AHEAD, _segments()


def sensor_documents() -> dict[str, dict[str, Any]]:
    """The sensors of forecasters, as plain JSON."""
    return {
        HISTORY_SENSOR: _document(HISTORY_SENSOR, history_shape(), 0.0, "Reported speeds of a road's segments in the "
            "last eight minutes, the oldest first, m/s; gaps are filled. Segments follow each other downstream."),
        CLOCK_SENSOR: _document(CLOCK_SENSOR, (1,), 0.0, "Time of day of the last row of `history`, s."),
    }  # fmt: skip


def control_document() -> dict[str, Any]:
    """The control of forecasters, as plain JSON."""
    return {
        "control": FORECASTING_CONTROL,
        "shape": list(forecast_shape()),
        "dtype": "float32",
        "low": 0.0,
        "high": 60.0,
        "description": "Speeds of the segments in the next three minutes, m/s.",
    }


def _document(name: str, shape: tuple[int, ...], low: float, description: str) -> dict[str, Any]:
    given = {"name": name, "track": TRACK, "shape": list(shape), "dtype": "float32"}
    return given | {"low": low, "high": None, "description": description}


@cache
def _segments() -> int:
    return segments()
