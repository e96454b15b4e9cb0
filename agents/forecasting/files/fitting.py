"""Forecasters from files for a road or a table of so many segments; one that does not fit is refused in words."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import numpy as np

from dohyo.agents.forecasting.base import Forecaster, columns_of, read_file
from dohyo.agents.forecasting.data.grid import Grid
from dohyo.agents.forecasting.data.speed_table import SpeedData
from dohyo.agents.forecasting.data.windows import HISTORY, HORIZON
from dohyo.agents.forecasting.exported import Exported
from dohyo.agents.forecasting.registry import load_forecaster
from dohyo.agents.learning.policies.session import session_from
from dohyo.sumo_networks.errors import InvalidInputError

Table = TypeVar("Table", Grid, SpeedData)
SAME_STEP = 0.01
TRIED_MPS = 20.0
"""Speed of the history that a model is tried with."""


class AnyWidth(Exported):
    """A model that leaves its number of segments open, on a road of N."""

    def __init__(self, path: Path, segments: int) -> None:
        Forecaster.__init__(self, segments)
        self.session, self.path = session_from(path, "forecaster"), path


def load_fitting(model: str, segments: int, exported: bool = False) -> Forecaster:
    """Trained forecaster; an ONNX model has the facts of the .safetensors file beside it.

    Args:
        model: A shipped one, or the path of a .safetensors or .onnx file.
        segments: Number of segments, N, for an ONNX model that leaves it open.
        exported: See `load_forecaster`.

    Raises:
        InvalidInputError: There is no such forecaster, its file is damaged, or it gives no forecast of three rows.
    """
    path = Path(model)
    is_open = path.suffix == ".onnx" and _leaves_width_open(path)
    forecaster = AnyWidth(path, segments) if is_open else load_forecaster(model, exported=exported)
    if isinstance(forecaster, Exported):
        _take_facts(forecaster)
        _try(forecaster)
    return forecaster


def check_fits(forecaster: Forecaster, segments: int, step_s: float | None, model: str, source: str) -> None:
    """Refuses a table that a forecaster was not trained for.

    Args:
        forecaster: Trained.
        segments: Number of columns.
        step_s: Seconds between two rows; None: too few rows to know.
        model: Name of the forecaster, for the message.
        source: Path of the table, for the message.

    Raises:
        InvalidInputError: The number of columns or the step differs.
    """
    if forecaster.segments != segments:
        raise InvalidInputError(
            f"'{model}' forecasts {forecaster.segments} segments, '{source}' has {segments}; train one on it with "
            "dohyo forecast fit"
        )
    if step_s is not None and abs(forecaster.step_s - step_s) > SAME_STEP * step_s:
        own, rows = forecaster.step_s / 60, step_s / 60
        raise InvalidInputError(
            f"'{model}' forecasts rows {own:g} min apart, those of '{source}' are {rows:g} min apart; "
            + (f"--resample {own:g}, or " if own > rows else "")
            + "train one on it with dohyo forecast fit"
        )


def in_order(table: Table, forecaster: Forecaster, model: str, source: str) -> Table:
    """A table with its columns in the order of those that a forecaster was trained on, and a note if they differ.

    Names of files are no reason to refuse a table, since a logger may begin another file each day.

    Raises:
        InvalidInputError: The columns have other names than those.
    """
    expected, names = forecaster.columns, table.names if isinstance(table, Grid) else table.segments
    if not expected or expected == names:
        return table
    if sorted(expected) == sorted(names):
        return table.chosen([names.index(name) for name in expected], f"columns were put in the order of '{model}'")
    others = [place for place, name in enumerate(expected) if name not in names] or [0]
    text = (
        f"'{model}' was trained on '{expected[others[0]]}', '{source}' has '{names[others[0]]}' in its place "
        f"({len(others)} of {len(expected)} columns differ)"
    )
    if table.named_by_file:
        return table.chosen(range(len(names)), f"{text}: the same detectors in the same order?")
    raise InvalidInputError(f"{text}; rename the columns, or train one on it with dohyo forecast fit")


def _take_facts(forecaster: Exported) -> None:
    """Time step and speed of 1 from the file beside a model, if there is one."""
    beside = forecaster.path.with_suffix(".safetensors")
    if not beside.is_file():
        return
    facts = read_file(beside)[0]
    try:
        forecaster.step_s = float(facts.get("step_s", forecaster.step_s))
        forecaster.free_mps = float(facts.get("free_mps", forecaster.free_mps))
        forecaster.columns = columns_of(facts)
    except ValueError as error:
        raise InvalidInputError(f"forecaster '{beside}' is damaged: {error}") from error


def _leaves_width_open(path: Path) -> bool:
    """Whether the input `history` is (8, N) with a name instead of a number N."""
    inputs = {one.name: one.shape for one in session_from(path, "forecaster").get_inputs()}
    shape = inputs.get("history", [])
    return len(inputs) == 1 and len(shape) == 2 and shape[0] == HISTORY and not isinstance(shape[1], int)


def _try(forecaster: Exported) -> None:
    """Refuses a model whose forecast has another shape than (3, N), or (3, 3, N) with intervals."""
    history = np.full((HISTORY, forecaster.segments), TRIED_MPS, dtype=np.float32)
    try:
        shape = np.shape(forecaster.session.run(None, {"history": history})[0])
    except Exception as error:  # onnxruntime's own errors share no base class
        raise InvalidInputError(
            f"'{forecaster.path}' fails on a history {history.shape} of float32: {str(error).splitlines()[0]}"
        ) from error
    expected = ((HORIZON, forecaster.segments), (HORIZON, 3, forecaster.segments))
    if shape not in expected:
        raise InvalidInputError(
            f"'{forecaster.path}': expected a forecast {expected[0]}, or {expected[1]} with intervals, got {shape}"
        )
