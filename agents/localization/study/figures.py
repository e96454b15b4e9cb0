"""Figures of localization: the track on the plane, its error over time, and the study's grid. Data in, Figure out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from dohyo.agents.localization.logs import PositionLog
from dohyo.agents.localization.track import EstimatedTrack
from dohyo.evaluation.report.style import OKABE_ITO, PALETTES, number, template
from dohyo.sumo_networks.arrays import FloatArray

ESTIMATE, FIXES, TRUTH, SMOOTHED = OKABE_ITO[0], OKABE_ITO[1], OKABE_ITO[2], OKABE_ITO[3]
SYMBOLS = ("circle", "square", "diamond", "triangle-up")


def track_figure(
    track: EstimatedTrack, gnss: PositionLog, truth: FloatArray | None, smoothed: EstimatedTrack | None = None
) -> go.Figure:
    """Track on the plane: fixes, estimate, and the truth if known.

    Args:
        track: The estimate.
        gnss: The fixes.
        truth: (K, 2) true positions at the track's times, m.
        smoothed: The smoother's track.
    """
    figure = go.Figure()
    figure.add_scatter(
        x=gnss.position[:, 0],
        y=gnss.position[:, 1],
        mode="markers",
        name="GNSS",
        marker={"color": FIXES, "size": 5, "symbol": "circle-open"},
    )
    if truth is not None:
        figure.add_scatter(x=truth[:, 0], y=truth[:, 1], mode="lines", name="truth", line={"color": TRUTH, "width": 4})
    figure.add_scatter(
        x=track.position[:, 0],
        y=track.position[:, 1],
        mode="lines",
        name="filter",
        line={"color": ESTIMATE, "width": 2},
    )
    if smoothed is not None:
        figure.add_scatter(
            x=smoothed.position[:, 0],
            y=smoothed.position[:, 1],
            mode="lines",
            name="smoothed",
            line={"color": SMOOTHED, "width": 2},
        )
    track = track if smoothed is None else smoothed
    length = float(np.hypot(*np.diff(track.position, axis=0).T).sum())
    finding = f"{number(length)} m in {number(float(track.time[-1] - track.time[0]))} s"
    _entitle(figure, finding, f"{len(gnss.time)} fixes, {track.rejected} left out as outliers.")
    figure.update_xaxes(title_text="east, m")
    figure.update_yaxes(title_text="north, m", scaleanchor="x", scaleratio=1)
    return figure.update_layout(height=580, showlegend=True, margin_t=112)


def error_figure(track: EstimatedTrack, truth: FloatArray) -> go.Figure:
    """Error of the estimate, and its own bound.

    Args:
        track: The estimate.
        truth: (K, 2) true positions at the track's times, m.
    """
    error = np.hypot(*(track.position - truth).T)
    # The ellipse would need the larger half-axis; the trace is simpler, and an upper bound.
    bound = 2.0 * np.sqrt(np.trace(track.covariance, axis1=1, axis2=2))
    every = max(1, len(error) // 4000)
    figure = go.Figure()
    figure.add_scatter(
        x=track.time[::every],
        y=bound[::every],
        mode="lines",
        name="what the filter expects at most (2 sigma)",
        line={"color": PALETTES["light"].quiet, "dash": "dot", "width": 1.5},
    )
    figure.add_scatter(
        x=track.time[::every], y=error[::every], mode="lines", name="error", line={"color": ESTIMATE, "width": 2}
    )
    share = 100.0 * float(np.mean(error <= 0.5))
    _entitle(figure, f"{number(share)} % of the time within 0.5 m", "Distance of the estimate from the truth.")
    figure.update_xaxes(title_text="t, s")
    figure.update_yaxes(title_text="m", rangemode="tozero")
    return figure.update_layout(height=384, showlegend=True, margin_t=112)


def nis_figure(track: EstimatedTrack, bound: float) -> go.Figure:
    """NIS of each fix.

    Args:
        track: The estimate.
        bound: 95 % quantile for a correct filter.
    """
    nis = track.nis
    figure = go.Figure()
    figure.add_scatter(
        x=np.arange(len(nis)),
        y=nis,
        mode="markers",
        name="NIS",
        marker={"color": ESTIMATE, "size": 5, "line": {"width": 0}},
    )
    figure.add_hline(y=bound, line={"color": PALETTES["light"].quiet, "dash": "dot"})
    share = 100.0 * float(np.mean(nis <= bound)) if len(nis) else 0.0
    _entitle(
        figure,
        f"{number(share)} % of the fixes lie where the filter expects 95 %",
        "Normalised innovation squared of each fix; the dotted line is the 95 % bound.",
    )
    figure.update_xaxes(title_text="fix")
    figure.update_yaxes(title_text="NIS", type="log")
    return figure.update_layout(height=320)


def grid_figure(cells: Sequence[Mapping[str, Any]], metric: str = "accuracy") -> go.Figure:
    """The study: one panel per arm, the metric over the fixes' error, a line per rate; ES-EKF only.

    Args:
        cells: Of the study's results.
        metric: A name of `study.METRICS`.
    """
    chosen = [c for c in cells if c["filter"] == "es-ekf" and c["correlated_share"] == 0.5 and c["vibration"] == 0.0]
    arms = list(dict.fromkeys(cell["arm"] for cell in chosen))
    rates = list(dict.fromkeys(cell["rate_hz"] for cell in chosen))
    figure = make_subplots(
        cols=len(arms),
        shared_yaxes=True,
        subplot_titles=[arm.replace("none", "no calibration") for arm in arms],
        horizontal_spacing=0.03,
    )
    for column, arm in enumerate(arms, 1):
        for rate, colour, symbol in zip(rates, OKABE_ITO, SYMBOLS, strict=False):
            line = [cell for cell in chosen if cell["arm"] == arm and cell["rate_hz"] == rate]
            means = [cell[metric]["mean"] for cell in line]
            figure.add_scatter(
                x=[cell["sigma_m"] for cell in line],
                y=means,
                error_y={
                    "symmetric": False,
                    "array": [cell[metric]["high"] - cell[metric]["mean"] for cell in line],
                    "arrayminus": [cell[metric]["mean"] - cell[metric]["low"] for cell in line],
                    "thickness": 1.3,
                    "width": 0,
                },
                mode="lines+markers",
                name=f"{rate:g} Hz",
                legendgroup=f"{rate:g}",
                showlegend=column == 1,
                marker={"color": colour, "symbol": symbol},
                line={"color": colour, "width": 1.5},
                row=1,
                col=column,
            )
    runs = chosen[0][metric]["n"] if chosen else 0
    _entitle(
        figure,
        "Without calibration nothing helps; with it, the receiver's error decides",
        f"ES-EKF, share of samples within 0.5 m; mean and 95 % interval over {runs} journeys.",
    )
    figure.update_xaxes(type="log", tickvals=[0.1, 0.3, 0.5, 1.0, 2.5], title_text="sigma of a fix, m")
    figure.update_yaxes(title_text="within 0.5 m, %", range=[-2, 102], col=1)
    return figure.update_layout(
        height=460,
        showlegend=True,
        legend={"yref": "container", "y": 0, "yanchor": "bottom"},
        margin_t=112,
        margin_b=96,
    )


def page(title: str, figures: Sequence[go.Figure], facts: Mapping[str, str]) -> str:
    """One HTML file that needs no network."""
    palette = PALETTES["light"]
    rows = "".join(f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in facts.items())
    drawn = "".join(
        figure.to_html(full_html=False, include_plotlyjs=False, config={"displayModeBar": False}) for figure in figures
    )
    style = (
        "body{font:15px/1.5 ui-sans-serif,system-ui,sans-serif;margin:32px auto;max-width:1040px;padding:0 16px;"
        f"background:#FAF8F4;color:{palette.ink}}}th{{text-align:left;font-weight:400;color:{palette.quiet};"
        "padding-right:24px}td{font-family:ui-monospace,monospace;text-align:right}"
    )
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{title}</title>'
    return (
        f'<!doctype html><html lang="en"><head>{head}<style>{style}</style><script>{get_plotlyjs()}</script></head>'
        f"<body><h1>{title}</h1><table>{rows}</table>{drawn}</body></html>"
    )


def _entitle(figure: go.Figure, finding: str, caption: str) -> None:
    figure.update_layout(template=template(), title={"text": finding, "subtitle": {"text": caption}})
