"""Figures of forecasts of one's own detectors: what was measured, what was forecast, and the interval."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike
from plotly.subplots import make_subplots

from dohyo.agents.forecasting.base import Forecaster
from dohyo.agents.forecasting.data.grid import Grid
from dohyo.agents.forecasting.data.speed_table import UNITS, SpeedData, Stretch
from dohyo.agents.forecasting.data.windows import HORIZON, make_windows
from dohyo.agents.forecasting.live.now import Forecast
from dohyo.evaluation.report.style import OKABE_ITO, label, template
from dohyo.sumo_networks.arrays import FloatArray

MEASURED, FORECAST = OKABE_ITO[7], OKABE_ITO[0]
MOST_SEGMENTS, SHOWN_STEPS = 4, 60
WIDTH_PX, PANEL_PX, TOP_PX = 1040, 220, 150


def now_figure(forecast: Forecast, grid: Grid, unit: str) -> go.Figure:
    """The latest rows and the forecast, a panel for each of the first segments."""
    figure = _panels(forecast.segments)
    rows = grid.place > grid.place[-1] - SHOWN_STEPS
    time_s = grid.start_s + grid.step_s * grid.place[rows].astype(np.float64)
    for number in range(min(len(forecast.segments), MOST_SEGMENTS)):
        latest = forecast.latest[number]
        ahead = np.concatenate([[latest], forecast.ahead[:, number]])
        low, high = (np.concatenate([[latest], ends[:, number]]) for ends in (forecast.low, forecast.high))
        times = np.concatenate([[forecast.made_s], forecast.times_s])
        _band(figure, number, times, low / UNITS[unit], high / UNITS[unit])
        _line(figure, number, time_s, grid.speeds[rows, number] / UNITS[unit], "measured", MEASURED)
        _line(figure, number, times, ahead / UNITS[unit], "forecast", FORECAST)
    caption = (
        f"The next {len(forecast.ahead)} steps after the last row; nine of ten speeds lie in the band in the long run."
    )
    return _finished(figure, "What comes next", caption, unit, len(forecast.segments))


def evaluation_figure(forecaster: Forecaster, data: SpeedData, name: str, unit: str) -> go.Figure:
    """The longest stretch of a set: measured speeds, and those forecast three steps before."""
    stretches: Sequence[Stretch] = data.stretches(name)
    longest = max(stretches, key=lambda one: int(np.isfinite(one.speeds).any(axis=1).sum()))
    windows = make_windows([longest], data.step_s)
    ahead = forecaster.predict_many(windows.history, windows.time_s)[:, -1]
    figure = _panels(data.segments)
    time_s = longest.start_s + data.step_s * np.arange(float(len(longest.speeds)))
    target_s = longest.start_s + data.step_s * (windows.row.astype(np.float64) + HORIZON)
    for number in range(min(len(data.segments), MOST_SEGMENTS)):
        _line(figure, number, time_s, longest.speeds[:, number] / UNITS[unit], "measured", MEASURED)
        _line(figure, number, target_s, ahead[:, number] / UNITS[unit], "forecast three steps before", FORECAST)
    return _finished(figure, f"{name}: {label(longest.name)}", "Rows that it has not seen.", unit, len(data.segments))


def _panels(segments: Sequence[str]) -> go.Figure:
    shown = [label(name) for name in segments[:MOST_SEGMENTS]]
    return make_subplots(rows=len(shown), shared_xaxes=True, subplot_titles=shown, vertical_spacing=0.08)


def _line(figure: go.Figure, number: int, time_s: FloatArray, speed: ArrayLike, name: str, colour: str) -> None:
    figure.add_scatter(
        x=_clock(time_s),
        y=speed,
        mode="lines+markers",
        name=name,
        legendgroup=name,
        showlegend=number == 0,
        marker={"size": 4, "line": {"width": 0}, "color": colour},
        line={"color": colour, "width": 1.5},
        row=number + 1,
        col=1,
    )


def _band(figure: go.Figure, number: int, time_s: FloatArray, low: FloatArray, high: FloatArray) -> None:
    if not np.isfinite(low[1:]).all():
        return
    figure.add_scatter(
        x=_clock(np.concatenate([time_s, time_s[::-1]])),
        y=np.concatenate([high, low[::-1]]),
        fill="toself",
        mode="lines",
        name="90 % interval",
        legendgroup="band",
        showlegend=number == 0,
        line={"width": 0},
        fillcolor="rgba(0, 114, 178, 0.18)",
        row=number + 1,
        col=1,
    )


def _clock(time_s: FloatArray) -> list[datetime]:
    return [datetime.fromtimestamp(float(one), UTC) for one in time_s]


def _finished(figure: go.Figure, title: str, caption: str, unit: str, segments: int) -> go.Figure:
    figure.update_layout(template=template(), title={"text": title, "subtitle": {"text": caption}})
    figure.update_yaxes(title_text=unit)
    height = PANEL_PX * min(segments, MOST_SEGMENTS) + TOP_PX + 60
    legend_y = 1.0 + 26.0 / (height - TOP_PX - 48.0)  # above the first panel's title, below the subtitle
    return figure.update_layout(width=WIDTH_PX, height=height, showlegend=True, margin_t=TOP_PX, legend={"y": legend_y})
