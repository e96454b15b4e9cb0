"""Draws docs/freeway.png: one morning's stop-and-go waves, with single vehicles and with queues.

Run it with `.venv/bin/python docs/freeway.py` (some minutes; needs chromium).
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from playwright.sync_api import sync_playwright
from plotly.subplots import make_subplots

from evaluation.figures import template
from sumo_networks.arrays import FloatArray
from sumo_networks.freeway import FreewayScenario, FreewaySimulation, load_freeway
from sumo_networks.freeway.days import drive_day
from sumo_networks.freeway.measure import SpaceTimeMap, wave_speed

PICTURE = Path(__file__).with_suffix(".png")
WIDTH, HEIGHT = 1240, 520
MORNING = FreewayScenario(seed=1, start_s=6.7 * 3600, duration_s=4200.0, warm_up_s=600.0)
WHOLE = MORNING.model_copy(update={"start_s": 5.0 * 3600, "duration_s": 5.5 * 3600})
CELL_S, CELL_M, LOOK_S = 10.0, 100.0, 2.0
CONGESTED_M, BEFORE_M = 3000.0, 8500.0
SLOW_TO_FAST = ["#3B0A0A", "#7F1D1D", "#B3362E", "#DE7A3C", "#F2C878", "#FAF3DC"]
INK, ACCENT = "#1F2328", "#5B4B8A"


def vehicles() -> FloatArray:
    """(time, space) mean speeds of the morning with single vehicles, m/s."""
    with FreewaySimulation(MORNING, fuel=False) as simulation:
        grid = SpaceTimeMap(simulation.road, MORNING.start_s, MORNING.duration_s, CELL_S, CELL_M)
        while simulation.world.time_s < MORNING.start_s + MORNING.duration_s:
            if simulation.world.time_s % LOOK_S == 0:
                grid.observe(simulation.world)
            simulation.tick()
    return grid.speed_mps()


def heat(speed_mps: FloatArray, minutes: FloatArray, km: FloatArray, bar: bool) -> go.Heatmap:
    """One map, time to the right and the road upwards."""
    return go.Heatmap(
        x=minutes / 60,
        y=km,
        z=3.6 * speed_mps.T,
        zmin=0,
        zmax=115,
        colorscale=SLOW_TO_FAST,
        showscale=bar,
        colorbar={"title": "km/h", "thickness": 12, "outlinewidth": 0},
    )


def main() -> None:
    """Drives both, draws them side by side, and prints how fast the waves travel."""
    road = load_freeway()
    micro = vehicles()
    meso = drive_day(WHOLE, "meso")
    part = micro[:, int(CONGESTED_M / CELL_M) : int(BEFORE_M / CELL_M)]
    kmh = 3.6 * wave_speed(part[len(part) // 3 :], CELL_S, CELL_M)
    print(f"waves travel at {kmh:.1f} km/h")
    panels = make_subplots(cols=2, shared_yaxes=True, horizontal_spacing=0.03, column_widths=[0.56, 0.44])
    times = MORNING.start_s / 60 + CELL_S / 60 * (np.arange(len(micro)) + 0.5)
    panels.add_trace(heat(micro, times, (np.arange(micro.shape[1]) + 0.5) * CELL_M / 1000, False), 1, 1)
    panels.add_trace(heat(meso.truth.speed_mps, meso.minute + 0.5, road.bounds_m / 1000, True), 1, 2)
    for column in (1, 2):
        panels.add_hline(road.bottleneck_m / 1000, line={"color": ACCENT, "dash": "dot", "width": 1}, row=1, col=column)
    panels.add_annotation(
        x=times[0] / 60 + 0.02, y=road.bottleneck_m / 1000 + 0.3, text="4 lanes become 3", showarrow=False,
        xanchor="left", font={"color": ACCENT, "size": 12}, bgcolor="rgba(250,248,244,0.8)", row=1, col=1,
    )  # fmt: skip
    panels.update_layout(
        template=template("light"),
        width=WIDTH,
        height=HEIGHT,
        margin={"t": 92, "b": 56, "l": 64, "r": 24},
        title={
            "text": f"Stop-and-go waves leave the bottleneck upstream at {abs(kmh):.0f} km/h"
            f"<br><sup>Left: every vehicle simulated, means of {CELL_S:.0f} s and {CELL_M:.0f} m. Right: the same "
            "morning in queues, means of minutes and segments. A Tuesday, seed 1; nothing is controlled.</sup>",
            "x": 0.01,
        },
    )
    panels.update_xaxes(title="hour of the day")
    panels.update_yaxes(title="km from the first segment", col=1)
    picture(panels)


def picture(figure: go.Figure) -> None:
    """Writes the picture.

    Raises:
        SystemExit: There is no chromium.
    """
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        raise SystemExit("expected chromium on this machine")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.set_content(figure.to_html(include_plotlyjs=True, config={"displayModeBar": False}))
        page.wait_for_selector(".main-svg")
        page.locator(".plotly-graph-div").screenshot(path=str(PICTURE))
        browser.close()
    print(f"picture: {PICTURE}")


if __name__ == "__main__":
    main()
