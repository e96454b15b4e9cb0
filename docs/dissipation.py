"""Draws docs/dissipation.png: one morning's speeds in time and space, uncontrolled and with a plan that 5 % follow.

Run it with `.venv/bin/python docs/dissipation.py` (some minutes; needs chromium). `--maps FILE` keeps what was driven.
"""

from __future__ import annotations

import argparse
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from playwright.sync_api import sync_playwright
from plotly.subplots import make_subplots

from agents.speed_planning.dissipation import LeadIn, Morning, controlled, is_observed
from agents.speed_planning.study import ARMS, in_a_copy
from evaluation.figures import template
from sumo_networks.arrays import FloatArray
from sumo_networks.freeway import FreewaySimulation, load_freeway
from sumo_networks.freeway.measure import SpaceTimeMap

PICTURE = Path(__file__).with_suffix(".png")
WIDTH, HEIGHT = 1240, 520
SEED, SHOWN = 101, ("none", "limit+persistence")
MORNING = Morning(duration_s=3000.0)
CELL_S, CELL_M = 30.0, 200.0
SLOW_TO_FAST = ["#3B0A0A", "#7F1D1D", "#B3362E", "#DE7A3C", "#F2C878", "#FAF3DC"]
ACCENT = "#5B4B8A"


def drive(lead_in: LeadIn, arm: str, path: Path) -> None:
    """Writes the (time, space) mean speeds of one arm, m/s."""
    grid = SpaceTimeMap(lead_in.simulation.road, MORNING.start_s, MORNING.duration_s, CELL_S, CELL_M)
    for world in controlled(lead_in, ARMS[arm], MORNING):
        if is_observed(world.time_s):
            grid.observe(world)
    np.save(path, grid.speed_mps())


def maps(folder: Path) -> list[FloatArray]:
    """The arms' maps, driven where they are not there."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = {arm: folder / f"{arm}.npy" for arm in SHOWN}
    missing = [arm for arm, path in paths.items() if not path.exists()]
    if missing:
        with FreewaySimulation(MORNING.scenario(SEED), fuel=False) as simulation:
            lead_in = LeadIn.driven(simulation, SEED, MORNING.start_s)
            for arm in missing:
                in_a_copy(arm, partial(drive, lead_in, arm, paths[arm]))
    return [np.load(path) for path in paths.values()]


def figure(speeds: list[FloatArray]) -> go.Figure:
    """The maps side by side, time to the right and the road upwards."""
    road = load_freeway()
    panels = make_subplots(
        cols=2, shared_yaxes=True, horizontal_spacing=0.03,
        subplot_titles=["nothing is controlled", "every twentieth car follows the smoothed state"],
    )  # fmt: skip
    for column, speed in enumerate(speeds, start=1):
        hours = (MORNING.start_s + CELL_S * (np.arange(len(speed)) + 0.5)) / 3600
        panels.add_trace(
            go.Heatmap(
                x=hours,
                y=(np.arange(speed.shape[1]) + 0.5) * CELL_M / 1000,
                z=3.6 * speed.T,
                zmin=0,
                zmax=115,
                colorscale=SLOW_TO_FAST,
                showscale=column == len(speeds),
                colorbar={"title": "km/h", "thickness": 12, "outlinewidth": 0},
            ),
            1,
            column,
        )
        panels.add_hline(road.bottleneck_m / 1000, line={"color": ACCENT, "dash": "dot", "width": 1}, row=1, col=column)
    panels.add_annotation(
        x=MORNING.start_s / 3600 + 0.02, y=road.bottleneck_m / 1000 + 0.3, text="4 lanes become 3", showarrow=False,
        xanchor="left", font={"color": ACCENT, "size": 12}, bgcolor="rgba(250,248,244,0.8)", row=1, col=1,
    )  # fmt: skip
    panels.update_layout(
        template=template("light"),
        width=WIDTH,
        height=HEIGHT,
        margin={"t": 110, "b": 56, "l": 64, "r": 24},
        title={
            "text": "A few slower cars upstream spread a breakdown out"
            f"<br><sup>Mean speeds of all vehicles in {CELL_S:.0f} s and {CELL_M:.0f} m; the same vehicles at the same "
            f"times in both. Seed {SEED}, one morning.</sup>",
            "x": 0.01,
        },
    )
    panels.update_xaxes(title="hour of the day")
    panels.update_yaxes(title="km from the first segment", col=1)
    return panels


def picture(drawn: go.Figure) -> None:
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
        page.set_content(drawn.to_html(include_plotlyjs=True, config={"displayModeBar": False}))
        page.wait_for_selector(".main-svg")
        page.locator(".plotly-graph-div").screenshot(path=str(PICTURE))
        browser.close()
    print(f"picture: {PICTURE}")


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--maps", type=Path, default=Path("out/dissipation-maps"))
    picture(figure(maps(parser.parse_args().maps)))


if __name__ == "__main__":
    main()
