"""Curves of trainings: a measure of held-out episodes by steps; a panel per task, a line per arm."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from dohyo.agents.studies.training_results import MEASURES, TrainingRun, Trainings, course
from dohyo.evaluation.report.style import OKABE_ITO, PALETTES, label, number, template
from dohyo.evaluation.statistics import Estimate

COLUMNS, WIDTH, PANEL, HEAD, FOOT = 3, 980, 220, 120, 90
"""Panels side by side; and sizes, px."""
COLOURS = (*OKABE_ITO[:6], OKABE_ITO[7], OKABE_ITO[6])
DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")
SYMBOLS = ("circle", "square", "diamond", "triangle-up", "triangle-down", "pentagon", "hexagon", "star")
_BAND = {"fill": "toself", "line_width": 0, "hoverinfo": "skip", "mode": "lines", "opacity": 0.16}


def draw(trainings: Trainings, told: Mapping[str, str], measure: str = "return") -> go.Figure:
    """A panel per task.

    Args:
        trainings: The trainings.
        told: Description of each arm in the legend; an arm's place here decides its look.
        measure: Of `MEASURES`.

    Raises:
        InvalidInputError: A run does not have that measure.
    """
    rows = -(-len(trainings) // COLUMNS)
    height = HEAD + rows * PANEL + FOOT
    columns = min(COLUMNS, len(trainings))
    spacing = {"vertical_spacing": 64 / (rows * PANEL), "horizontal_spacing": 0.07}
    drawn = make_subplots(rows=rows, cols=columns, subplot_titles=list(trainings), **spacing)
    arms = [*told, *sorted({arm for trained in trainings.values() for arm in trained} - told.keys())]
    for place, trained in enumerate(trainings.values()):
        panel = {"row": place // COLUMNS + 1, "col": place % COLUMNS + 1}
        for arm, runs in trained.items():
            drawn.add_traces(_arm(runs, measure, arms.index(arm)), rows=panel["row"], cols=panel["col"])
        if imitated := max(run.imitated for runs in trained.values() for run in runs):
            # At the end: plotly ignores shapes in an empty panel.
            grey = {"fillcolor": PALETTES["light"].line, "line_width": 0, "opacity": 0.6, "layer": "below"}
            drawn.add_vrect(x0=0, x1=imitated / 1e3, **panel, **grey)
    for key in _legend(trainings, arms, told):
        drawn.add_trace(key, row=1, col=1)
    if measure == "success":
        drawn.update_yaxes(range=[0, 105], dtick=25)
    drawn.update_yaxes(title_text=MEASURES[measure], col=1)
    drawn.update_xaxes(rangemode="tozero")
    for place in range(max(len(trainings) - columns, 0), len(trainings)):
        drawn.update_xaxes(title_text="steps, thousands", row=place // COLUMNS + 1, col=place % COLUMNS + 1)
    return drawn.update_layout(
        template=template(),
        title={"text": finding(trainings, measure), "subtitle": {"text": _caption(trainings)}},
        title_y=1 - 24 / height, title_yanchor="top", width=WIDTH, height=height, margin={"t": HEAD, "b": FOOT},
        legend={"y": -56 / (rows * PANEL), "yanchor": "top", "itemwidth": 46},
    )  # fmt: skip


def finding(trainings: Trainings, measure: str) -> str:
    """Arms with the highest end, by number of tasks, and how often its interval is above the next one's."""
    ends = {
        task: sorted(
            ((found[-1], arm) for arm, runs in arms.items() if (found := course(runs, measure)[1])),
            key=lambda end: -(end[0].mean or 0.0),
        )
        for task, arms in trainings.items()
    }
    what = MEASURES[measure].partition(",")[0]
    contests = [found for found in ends.values() if len(found) > 1]
    if not contests:
        alone = (f"{task} {number(found[0][0].mean or 0.0)}" for task, found in ends.items() if found)
        return f"Held-out {what} at the end: {', '.join(alone)}"
    first = Counter("nobody" if found[0][0].mean == found[1][0].mean else label(found[0][1]) for found in contests)
    told = ", ".join(f"{arm} in {times}" for arm, times in first.most_common())
    apart = sum(_above(found[0][0], found[1][0]) for found in contests)
    count = "1 task" if len(contests) == 1 else f"{len(contests)} tasks"
    return f"Highest {what} at the end, of {count}: {told}; intervals apart in {apart}"


def _above(one: Estimate, other: Estimate) -> bool:
    return one.low is not None and other.high is not None and one.low > other.high


def _arm(runs: Sequence[TrainingRun], measure: str, place: int) -> list[go.Scatter]:
    """Means over seeds with a band; whiskers for one seed or one point."""
    steps, found = course(runs, measure)
    middle = np.array([one.mean for one in found], dtype=float)
    low = np.array([one.mean if one.low is None else one.low for one in found], dtype=float)
    high = np.array([one.mean if one.high is None else one.high for one in found], dtype=float)
    x, colour = steps / 1e3, COLOURS[place % len(COLOURS)]
    line = go.Scatter(x=x, y=middle, mode="lines+markers", showlegend=False, **_look(place))
    if len(runs) == 1 or len(x) == 1:
        whiskers = {"type": "data", "array": high - middle, "arrayminus": middle - low}
        return [line.update(error_y={**whiskers, "color": colour, "thickness": 1.2, "width": 0})]
    outline = {"x": [*x, *x[::-1]], "y": [*high, *low[::-1]]}
    return [go.Scatter(**outline, **_BAND, fillcolor=colour, showlegend=False), line]


def _look(place: int) -> dict[str, Any]:
    colour = COLOURS[place % len(COLOURS)]
    return {
        "line": {"color": colour, "width": 1.8, "dash": DASHES[place % len(DASHES)]},
        "marker": {"color": colour, "size": 7, "symbol": SYMBOLS[place % len(SYMBOLS)]},
    }


def _legend(trainings: Trainings, arms: Sequence[str], told: Mapping[str, str]) -> list[go.Scatter]:
    """A legend entry per arm, with its number of seeds."""
    keys = []
    for place, arm in enumerate(arms):
        counts = [len(trained[arm]) for trained in trainings.values() if arm in trained]
        if counts:
            seeds = f"{min(counts)}" if min(counts) == max(counts) else f"{min(counts)} to {max(counts)}"
            what = f" ({told[arm]})" if arm in told else ""
            name = f"{label(arm)}{what}, {seeds} seed{'' if max(counts) == 1 else 's'}"
            keys.append(go.Scatter(x=[None], y=[None], mode="lines+markers", name=name, **_look(place)))
    return keys


def _caption(trainings: Trainings) -> str:
    runs = [run for arms in trainings.values() for trained in arms.values() for run in trained]
    counts = sorted({int(n) for run in runs for n in run.evaluations.get("episodes", ()) if np.isfinite(n)})
    said = f"n = {' or '.join(map(str, counts))} held-out episodes, without exploration. "
    said += "Bands: 95 % over seeds (t); whiskers: 95 % over the episodes of a single seed.<br>"
    return said + "Grey: steps in which arms that imitate the rules do so."
