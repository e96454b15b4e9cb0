"""Figures: space-time maps of a congested morning, measured and forecast, and speeds along the road in four stages.

    python -m dohyo.agents.forecasting.study.figures --data DIR --day 1 --out agents/forecasting/results/forecasts.html

With chromium and playwright on the machine a PNG is written beside the page.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from dohyo.agents.forecasting.base import Forecaster
from dohyo.agents.forecasting.data.gaps import fill
from dohyo.agents.forecasting.data.reading import read_data
from dohyo.agents.forecasting.data.windows import HORIZON, Windows, make_windows
from dohyo.agents.forecasting.registry import load_forecaster
from dohyo.evaluation.report.pictures import write_page
from dohyo.evaluation.report.style import OKABE_ITO, PALETTES, template
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError

SLOW_TO_FAST = ((0.0, "#5C0A12"), (0.25, "#B3362E"), (0.5, "#E08A4F"), (0.75, "#F3CF9B"), (1.0, "#FAF3E3"))
"""Colours: dark for standing traffic, pale for free flow."""
JAM_SHARE = 0.5
"""Share of the free speed below which traffic is congested."""
STAGES = ("free flow", "onset", "congestion", "dissipation")
SHOWN = (
    ("SA-LSTM, 1 minute ahead", "sa-lstm", 0),
    ("n-step, 3 minutes ahead", "sa-lstm-n-step", 2),
    ("recursive, 3 minutes ahead", "sa-lstm", 2),
)
SIZE = (1040, 1180)


def stages(measured: Float32Array, free_mps: float) -> dict[str, int]:
    """Rows (T, N) at which traffic flows, a queue begins, is longest, and has shrunk to a half.

    Raises:
        InvalidInputError: There is no congestion.
    """
    slow = np.convolve((measured < JAM_SHARE * free_mps).mean(axis=1), np.ones(5) / 5, mode="same")
    worst = int(slow.argmax())
    if slow[worst] == 0.0:
        raise InvalidInputError("expected a congested day, got no speed below half the free speed")
    before, after = slow[: worst + 1], slow[worst:]
    onset = int(np.flatnonzero(before <= 0.25 * slow[worst])[-1]) if (before <= 0.25 * slow[worst]).any() else 0
    gone = np.flatnonzero(after <= 0.5 * slow[worst])
    late = worst + int(gone[0]) if len(gone) else len(slow) - 1
    return dict(zip(STAGES, (int(before[: onset + 1].argmin()), onset, worst, late), strict=True))


def forecasts(windows: Windows, forecasters: Mapping[str, Forecaster]) -> dict[str, Float32Array]:
    """(B, N) measured speeds three rows after each history, and their forecasts, km/h."""
    after = windows.target[:, HORIZON - 1]
    out = {"measured": np.where(np.isnan(after), fill(windows.target)[:, HORIZON - 1], after)}
    for label, name, row in SHOWN:
        ahead = forecasters[name].predict_many(windows.history, windows.time_s)[:, row]
        late = HORIZON - 1 - row  # a forecast for the same minute, made later
        out[label] = np.concatenate([ahead[late:], np.repeat(ahead[-1:], late, axis=0)])
    return {label: np.asarray(3.6 * np.maximum(speeds, 0.0)) for label, speeds in out.items()}


def figure(windows: Windows, forecasters: Mapping[str, Forecaster], free_mps: float, what: str) -> go.Figure:
    """Four space-time maps over four curves."""
    speeds = forecasts(windows, forecasters)
    minutes = windows.time_s / 60.0 + HORIZON
    at = stages(speeds["measured"] / 3.6, free_mps)
    titles = [*speeds, *(f"{stage}, {_clock(minutes[row])}" for stage, row in at.items())]
    drawn = make_subplots(rows=4, cols=2, subplot_titles=titles, vertical_spacing=0.075, horizontal_spacing=0.07)
    for place, (_, table) in enumerate(speeds.items()):
        scale = {"colorscale": SLOW_TO_FAST, "zmin": 0.0, "zmax": 3.6 * free_mps, "showscale": place == 0}
        bar = {"title": {"text": "km/h"}, "thickness": 10, "len": 0.4, "y": 0.78}
        trace = go.Heatmap(z=table.T, x=minutes / 60.0, y=np.arange(table.shape[1]), colorbar=bar, **scale)
        drawn.add_trace(trace, place // 2 + 1, place % 2 + 1)
    dashes = ("solid", "solid", "dash", "dot")
    colours = (PALETTES["light"].ink, *OKABE_ITO)
    for place, row in enumerate(at.values()):
        for (label, table), dash, colour in zip(speeds.items(), dashes, colours, strict=False):
            line = {"color": colour, "dash": dash, "width": 2.5 if label == "measured" else 1.7}
            trace = go.Scatter(
                y=table[row], mode="lines", name=label, legendgroup=label, line=line, showlegend=not place
            )
            drawn.add_trace(trace, place // 2 + 3, place % 2 + 1)
    drawn.update_xaxes(title_text="time of day, h", row=2)
    drawn.update_xaxes(title_text="segment, along the road", row=4)
    drawn.update_yaxes(title_text="segment", row=1, col=1)
    drawn.update_yaxes(title_text="segment", row=2, col=1)
    for row in (3, 4):
        drawn.update_yaxes(title_text="km/h", range=[0, 4.0 * free_mps], row=row, col=1)
        drawn.update_yaxes(range=[0, 4.0 * free_mps], row=row, col=2)
    return drawn.update_layout(
        template=template(),
        title={"text": _finding(speeds), "subtitle": {"text": f"{what}; forecasts stand at the minute they are for."}},
        width=SIZE[0], height=SIZE[1], showlegend=True, margin_t=120,
        legend={"orientation": "h", "y": -0.06},
    )  # fmt: skip


def _finding(speeds: Mapping[str, Float32Array]) -> str:
    errors = {label: float(np.sqrt(np.mean((table - speeds["measured"]) ** 2))) for label, table in speeds.items()}
    one, step, fed = (errors[label] for label, _, _ in SHOWN)
    three = f"three minutes ahead {step:.1f} (n-step) and {fed:.1f} (recursive)"
    return f"One minute ahead the error is {one:.1f} km/h, {three}"


def _clock(minute: float) -> str:
    return f"{int(minute) // 60 % 24}:{int(minute) % 60:02d}"


def main() -> None:
    """Draws one set of Hard."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--set", default="hard")
    parser.add_argument("--day", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/forecasting/forecasts.html"))
    arguments = parser.parse_args()
    data = read_data(arguments.data)
    days = data.stretches(arguments.set)
    if not 1 <= arguments.day <= len(days):
        raise InvalidInputError(f"expected --day 1 to {len(days)}, got {arguments.day}")
    forecasters = {name: load_forecaster(name) for name in {name for _, name, _ in SHOWN}}
    windows = make_windows([days[arguments.day - 1]], data.step_s)
    free_mps = next(iter(forecasters.values())).free_mps
    what = f"{days[arguments.day - 1].name} of {data.source}"
    drawn = figure(windows, forecasters, free_mps, what)
    for path in write_page(drawn, arguments.out, "Forecasts"):
        print(f"figure: {path}")


if __name__ == "__main__":
    main()
