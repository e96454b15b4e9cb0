"""Time of a decision, as a picture: python -m dohyo.agents.mcts.study.speed [FILE.json].

The numbers are those of `python tests/performance/planners.py agents/mcts/results/speed.json`. Writes a page that needs
no network, and a picture beside it if chromium is installed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from dohyo.evaluation.report.pictures import write_page
from dohyo.evaluation.report.style import OKABE_ITO, PALETTES, template
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError

RESULTS = Path(__file__).parents[1].joinpath("results") / "speed.json"
SIZE = (980, 460)
WAYS = {
    "learned": "as by default: learned predictor",
    "constant velocity": "constant velocity",
    "value network": "learned predictor, value network from 4 s on",
}
MEDIAN_GOAL_MS = 10.0


def draw(document: Mapping[str, Any]) -> go.Figure:
    """Time on the processor against simulations and against actors: the median, and up to the 99th percentile.

    Raises:
        InvalidInputError: The file is no result of the bench.
    """
    try:
        panels = [document["by_simulations"], document["by_actors"]]
        usual = panels[0]["learned"]["256"]
        drawn = make_subplots(cols=2, shared_yaxes=False, subplot_titles=("30 actors", "256 simulations"))
        for column, panel in enumerate(panels, start=1):
            for color, (way, label) in zip(OKABE_ITO, WAYS.items(), strict=False):
                _add(drawn, column, panel[way], color, label)
    except (KeyError, TypeError) as error:
        raise InvalidInputError(f"expected a result of tests/performance/planners.py, {error} is missing") from error
    median, p99 = usual["cpu_median_ms"], usual["cpu_p99_ms"]
    for column in (1, 2):
        drawn.add_hline(
            MEDIAN_GOAL_MS, line={"color": PALETTES["light"].quiet, "width": 1, "dash": "dot"}, col=column, row=1
        )  # fmt: skip
        drawn.update_yaxes(title="ms of a core" if column == 1 else None, rangemode="tozero", col=column)
    drawn.update_xaxes(title="simulations", type="log", tickvals=[64, 256, 1024, 4096], col=1)
    drawn.update_yaxes(type="log", tickvals=[2, 5, 10, 20, 50, 100], col=1)
    drawn.update_xaxes(title="actors around (the sensor shows the nearest 48)", col=2)
    what = "Dots: median of 100 decisions; shade: up to the 99th percentile; dotted: 10 ms"
    return drawn.update_layout(
        template=template(),
        title={
            "text": f"With 256 simulations among 30 actors a decision takes {median:.1f} ms ({p99:.1f} at the 99th "
            "percentile)",
            "subtitle": {"text": what},
        },
        width=SIZE[0], height=SIZE[1], margin_t=110, legend={"orientation": "h", "y": -0.26},
    )  # fmt: skip


def _add(drawn: go.Figure, column: int, row: Mapping[str, Mapping[str, float]], color: str, label: str) -> None:
    x = [int(n) for n in row]
    median, p99 = ([row[str(n)][key] for n in x] for key in ("cpu_median_ms", "cpu_p99_ms"))
    shade = f"rgba({int(color[1:3], 16)},{int(color[3:5], 16)},{int(color[5:7], 16)},0.15)"
    drawn.add_scatter(
        x=x + x[::-1], y=p99 + median[::-1], mode="lines", line={"width": 0}, fill="toself", fillcolor=shade,
        hoverinfo="skip", showlegend=False, row=1, col=column,
    )  # fmt: skip
    drawn.add_scatter(
        x=x, y=median, mode="lines+markers", line={"color": color}, name=label, legendgroup=label,
        showlegend=column == 1, row=1, col=column,
    )  # fmt: skip


def main() -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="?", default=RESULTS)
    parser.add_argument("--out", type=Path, default=Path("out/mcts/speed.html"), help="the page")
    given = parser.parse_args()
    try:
        document = json.loads(given.results.read_text())
    except OSError as error:
        raise InvalidInputError(f"cannot read '{given.results}': {error.strerror}") from error
    except json.JSONDecodeError as error:
        raise InvalidInputError(f"'{given.results}' is no JSON: {error}") from error
    for path in write_page(draw(document), given.out, "Decision time"):
        print(f"figure: {path}")


if __name__ == "__main__":
    try:
        main()
    except DohyoError as error:
        sys.exit(f"speed: {error}")
