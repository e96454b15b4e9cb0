"""Pictures of speeds in time and space: maps of one freeway side by side, for `freeway.py` and `dissipation.py`."""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from dohyo.evaluation.report.pictures import write_page
from dohyo.evaluation.report.style import template
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.freeway import FreewayRoad

WIDTH, HEIGHT = 1240, 520
FREE_KMH = 115
MOST_TICKS = 12
SLOW_TO_FAST = ["#3B0A0A", "#7F1D1D", "#B3362E", "#DE7A3C", "#F2C878", "#FAF3DC"]
ACCENT = "#5B4B8A"


@dataclass(frozen=True, eq=False)
class SpeedMap:
    """One map.

    Attributes:
        hour: (T,) of the day.
        km: (X,) along the mainline, from the first segment.
        speed_mps: (T, X) mean, NaN where nobody was.
        title: Above it.
    """

    hour: FloatArray
    km: FloatArray
    speed_mps: FloatArray
    title: str = ""

    def heat(self, bar: bool) -> go.Heatmap:
        """It as a trace, time to the right and the road upwards."""
        return go.Heatmap(
            x=self.hour,
            y=self.km,
            z=3.6 * self.speed_mps.T,
            zmin=0,
            zmax=FREE_KMH,
            colorscale=SLOW_TO_FAST,
            showscale=bar,
            colorbar={"title": "km/h", "thickness": 12, "outlinewidth": 0},
        )


def side_by_side(
    maps: Sequence[SpeedMap], road: FreewayRoad, title: str, caption: str, widths: Sequence[float] | None = None
) -> go.Figure:
    """Maps of one road, with the place where it loses a lane."""
    panels = make_subplots(
        cols=len(maps), shared_yaxes=True, horizontal_spacing=0.03, column_widths=widths,
        subplot_titles=[one.title for one in maps],
    )  # fmt: skip
    for column, one in enumerate(maps, start=1):
        panels.add_trace(one.heat(bar=column == len(maps)), 1, column)
        panels.add_hline(road.bottleneck_m / 1000, line={"color": ACCENT, "dash": "dot", "width": 1}, row=1, col=column)
    panels.add_annotation(
        x=float(maps[0].hour[0]) + 0.02, y=road.bottleneck_m / 1000 + 0.3, text="4 lanes become 3", showarrow=False,
        xanchor="left", font={"color": ACCENT, "size": 12}, bgcolor="rgba(250,248,244,0.8)", row=1, col=1,
    )  # fmt: skip
    panels.update_layout(
        template=template("light"),
        width=WIDTH,
        height=HEIGHT,
        margin={"t": 110 if any(one.title for one in maps) else 92, "b": 56, "l": 64, "r": 24},
        title={"text": title, "subtitle": {"text": caption}},
    )
    for column, one in enumerate(maps, start=1):
        panels.update_xaxes(title="time of day", **_clock(one), col=column)
    panels.update_yaxes(title="km from the first segment", col=1)
    return panels


def _clock(one: SpeedMap) -> dict[str, list[float] | list[str]]:
    """Ticks every quarter of an hour, as people read the time of day."""
    quarters = range(math.ceil(4 * one.hour[0]), math.floor(4 * one.hour[-1]) + 1)
    step = 1 if len(quarters) < MOST_TICKS else 4
    shown = [quarter for quarter in quarters if quarter % step == 0]
    return {
        "tickvals": [quarter / 4 for quarter in shown],
        "ticktext": [f"{quarter // 4}:{15 * (quarter % 4):02}" for quarter in shown],
    }


def write_picture(figure: go.Figure, path: Path) -> None:
    """Writes a figure as PNG.

    Raises:
        SystemExit: There is no chromium.
    """
    with tempfile.TemporaryDirectory() as folder:
        _, *pictures = write_page(figure, Path(folder) / "figure.html", path.stem)
        if not pictures:
            raise SystemExit("expected chromium on this machine")
        shutil.copyfile(pictures[0], path)
    print(f"picture: {path}")
