"""Curves of the trainings: success on held-out episodes and in training, by steps; a panel per policy.

    python -m agents.hierarchical.curves runs/ghrl --out out/hierarchical/curves.html

Of each run in the folder it reads config.toml, metrics.csv and evaluations.csv. With chromium and playwright on the
machine a PNG is written beside the page.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from agents.hierarchical.manoeuvres import Manoeuvre
from evaluation.figures import OKABE_ITO, PALETTES, template
from evaluation.pictures import write_page
from sumo_networks.arrays import FloatArray
from sumo_networks.errors import DohyoError, InvalidInputError

RESULTS = Path(__file__).with_name("results") / "training"
POLICIES = (*(one.value for one in Manoeuvre), "master")
COLUMNS, SIZE = 3, (980, 560)
ROUNDS = 8
"""That a point of the curve of the training is a mean over."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One run.

    Attributes:
        steps: (E,) at which it was evaluated.
        success: (E, 3) of held-out episodes, in %, with its 95 % interval.
        episodes: (E,) how many those were.
        trained: (R, 2) steps, and the success in %, of the training's rounds in which episodes ended.
        imitated: Steps before the first round.
    """

    steps: FloatArray
    success: FloatArray
    episodes: FloatArray
    trained: FloatArray
    imitated: int


def read_curve(folder: Path) -> Curve:
    """The curve of a run.

    Raises:
        InvalidInputError: A file of it is missing, or the run was never evaluated.
    """
    try:
        config = tomllib.loads((folder / "config.toml").read_text())
        held_out, rounds = (_rows(folder / name) for name in ("evaluations.csv", "metrics.csv"))
    except OSError as error:
        raise InvalidInputError(f"'{folder}' is no run: {error.strerror} ({error.filename})") from error
    if not held_out:
        raise InvalidInputError(f"'{folder}': expected a run that has been evaluated, evaluations.csv is empty")
    names = ("success", "success_low", "success_high")
    return Curve(
        np.array([float(row["steps"]) for row in held_out]),
        np.array([[float(row[name]) for name in names] for row in held_out]),
        np.array([float(row["episodes"]) for row in held_out]),
        np.array([(float(row["steps"]), float(row["success"])) for row in rounds if row["success"]]).reshape(-1, 2),
        int(config.get("ppo", {}).get("imitated_steps", 0)),
    )


def draw(curves: Mapping[str, Curve]) -> go.Figure:
    """A panel per policy: points with whiskers for held-out episodes, a line for training."""
    rows = -(-len(curves) // COLUMNS)
    drawn = make_subplots(rows=rows, cols=COLUMNS, subplot_titles=list(curves), vertical_spacing=0.16)
    for place, (name, curve) in enumerate(curves.items()):
        _add(drawn, curve, place // COLUMNS + 1, place % COLUMNS + 1, OKABE_ITO[POLICIES.index(name)])
    drawn.update_yaxes(range=[0, 105], dtick=25)
    drawn.update_yaxes(title_text="success, %", col=1)
    drawn.update_xaxes(title_text="steps, thousands", row=rows, rangemode="tozero")
    drawn.update_xaxes(rangemode="tozero")
    episodes = sorted({int(count) for curve in curves.values() for count in curve.episodes})
    caption = (
        f"Points: n = {' or '.join(map(str, episodes))} held-out episodes without exploration, 95 % intervals.<br>"
        f"Lines: the last {ROUNDS} rounds of training, with exploration. Grey: steps in which the rules were imitated."
    )
    return drawn.update_layout(
        template=template(),
        title={"text": _finding(curves), "subtitle": {"text": caption}},
        width=SIZE[0], height=SIZE[1], showlegend=False, margin_t=130,
    )  # fmt: skip


def _add(drawn: go.Figure, curve: Curve, row: int, column: int, colour: str) -> None:
    palette = PALETTES["light"]
    if len(curve.trained):
        counts = np.minimum(np.arange(1, len(curve.trained) + 1), ROUNDS)
        sums = np.cumsum(curve.trained[:, 1])
        sums[ROUNDS:] = sums[ROUNDS:] - sums[:-ROUNDS]
        line = {"color": colour, "width": 1.6}
        trace = go.Scatter(x=curve.trained[:, 0] / 1e3, y=sums / counts, mode="lines", line=line)
        drawn.add_trace(trace, row, column)
    middle, low, high = curve.success.T
    whiskers = {"type": "data", "array": high - middle, "arrayminus": middle - low, "color": palette.quiet}
    points = go.Scatter(
        x=curve.steps / 1e3, y=middle, mode="markers", error_y={**whiskers, "thickness": 1.3, "width": 0},
        marker={"color": colour},
    )  # fmt: skip
    drawn.add_trace(points, row, column)
    if curve.imitated:  # at the end: plotly leaves out what is put into an empty panel
        band = {"fillcolor": palette.line, "line_width": 0, "opacity": 0.6, "layer": "below"}
        drawn.add_vrect(x0=0, x1=curve.imitated / 1e3, row=row, col=column, **band)


def _finding(curves: Mapping[str, Curve]) -> str:
    told = ", ".join(f"{name} {curve.success[-1, 0]:.0f} %" for name, curve in curves.items())
    return f"Success at the end: {told}"


def _rows(path: Path) -> list[dict[str, Any]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="?", default=RESULTS)
    parser.add_argument("--out", type=Path, default=Path("out/hierarchical/curves.html"), help="the page")
    given = parser.parse_args(arguments)
    curves = {name: read_curve(given.runs / name) for name in POLICIES if (given.runs / name).is_dir()}
    if not curves:
        raise InvalidInputError(f"'{given.runs}': expected runs named as one of {', '.join(POLICIES)}, found none")
    for path in write_page(draw(curves), given.out, "How GHRL's policies learned"):
        print(f"figure: {path}")


if __name__ == "__main__":
    try:
        main()
    except DohyoError as error:
        sys.exit(f"curves: {error}")
