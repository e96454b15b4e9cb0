"""Forecasters from files for a road or a table of so many segments; one that does not fit is refused in words."""

from __future__ import annotations

from dohyo.agents.forecasting.base import Forecaster, read_file
from dohyo.agents.forecasting.exported import Exported
from dohyo.agents.forecasting.registry import load_forecaster
from dohyo.sumo_networks.errors import InvalidInputError

SAME_STEP = 0.01


def load_fitting(model: str, exported: bool = False) -> Forecaster:
    """Trained forecaster; an ONNX model has the facts of the .safetensors file beside it.

    Args:
        model: A shipped one, or the path of a .safetensors or .onnx file.
        exported: See `load_forecaster`.

    Raises:
        InvalidInputError: There is no such forecaster, or its file is damaged.
    """
    forecaster = load_forecaster(model, exported=exported)
    if isinstance(forecaster, Exported):
        _take_facts(forecaster)
    return forecaster


def check_fits(forecaster: Forecaster, segments: int, step_s: float, model: str, source: str) -> None:
    """Refuses a table that a forecaster was not trained for.

    Raises:
        InvalidInputError: The number of columns or the step differs.
    """
    if forecaster.segments != segments:
        raise InvalidInputError(
            f"'{model}' forecasts {forecaster.segments} segments, '{source}' has {segments}; train one on it with "
            "dohyo forecast fit"
        )
    if abs(forecaster.step_s - step_s) > SAME_STEP * step_s:
        own, rows = forecaster.step_s / 60, step_s / 60
        raise InvalidInputError(
            f"'{model}' forecasts rows {own:g} min apart, those of '{source}' are {rows:g} min apart; "
            + (f"--resample {own:g}, or " if own > rows else "")
            + "train one on it with dohyo forecast fit"
        )


def _take_facts(forecaster: Exported) -> None:
    """Time step and speed of 1 from the file beside a model, if there is one."""
    beside = forecaster.path.with_suffix(".safetensors")
    if not beside.is_file():
        return
    facts = read_file(beside)[0]
    try:
        forecaster.step_s = float(facts.get("step_s", forecaster.step_s))
        forecaster.free_mps = float(facts.get("free_mps", forecaster.free_mps))
    except ValueError as error:
        raise InvalidInputError(f"forecaster '{beside}' is damaged: {error}") from error
