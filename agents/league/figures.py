"""Figures of the league: score against the time of a decision, and infractions per km.

    python -m dohyo.agents.league.figures --out out/league

Writes pages that need no network, and pictures beside them if chromium is installed.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import plotly.graph_objects as go

from dohyo.agents.league.edition import DOCUMENT, PUBLISHED, Edition, read_edition
from dohyo.agents.league.rows import read_comparable_rows
from dohyo.agents.league.standings import Place, standings
from dohyo.agents.studies.rows import Row, infractions_per_km, is_lost
from dohyo.evaluation.families import Family
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.report.pictures import write_page
from dohyo.evaluation.report.style import PALETTES, agent_colours, template
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError

Box = tuple[float, float, float, float]
"""Left, top, right and bottom, pixels."""
SIZE: Final = (980, 520)
LABEL_PX: Final = 12
TIMES_MS: Final = (0.01, 40.0)
SCORES: Final = (-4.0, 104.0)
SECTION: Final = """## What a decision costs

![Mean headline of each driver over the time of a decision](pictures/league-speed.png)

## What each driver does wrong

![Infractions per km of each driver, by kind](pictures/league-infractions.png)

Over all driving disciplines; `python -m dohyo.agents.league.figures --out docs/pictures` draws both pictures.

## What holds where nobody learned

![Success of each learned driver where it learned, and where it never was](pictures/league-gap.png)

On missions of their own, beside the autopilot, which learned in neither town:
[the numbers](researchers/systems/generalisation.md). These drives are of dohyo 0.1.0."""
"""Pictures on the page of the published edition."""
FEWEST: Final = 0.02
"""Rate below which a kind of infraction is left out, per km."""


@dataclass(frozen=True, slots=True)
class Driver:
    """A driver over all driving disciplines.

    Attributes:
        name: Of the entrant.
        decision_ms: Geometric mean of its medians, ms.
        score: Mean of its headlines, each 0 to 100.
        margin: Half of the 95 % interval of that mean.
    """

    name: str
    decision_ms: float
    score: float
    margin: float


def speed_figure(edition: Edition, rows: Sequence[Row]) -> go.Figure:
    """Mean headline over all driving disciplines against the time of a decision; the line joins who is not dominated.

    Raises:
        InvalidInputError: Nobody has rows of every driving discipline.
    """
    found = drivers(edition, rows)
    if not found:
        raise InvalidInputError("expected a driver with rows of every driving discipline, found none")
    colours = agent_colours(one.name for one in edition.entrants if one.family is Family.DRIVING)
    best, places = front(found), label_places(found)
    drawn = go.Figure()
    drawn.add_scatter(
        x=[one.decision_ms for one in best], y=[one.score for one in best], mode="lines", hoverinfo="skip",
        line={"color": PALETTES["light"].quiet, "width": 1, "dash": "dot", "shape": "hv"},
    )  # fmt: skip
    for one, place in zip(found, places, strict=True):
        drawn.add_scatter(
            x=[one.decision_ms], y=[one.score], mode="markers+text", text=[one.name], textposition=place,
            textfont={"size": LABEL_PX}, marker={"color": colours[one.name], "size": 10},
            error_y={"array": [one.margin], "thickness": 1, "width": 3},
        )  # fmt: skip
    drawn.update_yaxes(title="mean of the headlines", range=[*SCORES])
    drawn.update_xaxes(type="log", title="ms of a decision", dtick=1, range=[math.log10(one) for one in TIMES_MS])
    return drawn.update_layout(
        template=template(), showlegend=False, width=SIZE[0], height=SIZE[1], margin_t=90,
        title={
            "text": "What a decision costs, and what it earns",
            "subtitle": {
                "text": "Over all driving disciplines; 95 % intervals; times of different machines; "
                "line: nobody is faster and better"
            },
        },
    )  # fmt: skip


def drivers(edition: Edition, rows: Sequence[Row]) -> list[Driver]:
    """Drivers with rows of every driving discipline, in the order of the edition."""
    disciplines = [one for one in edition.disciplines if one.family is Family.DRIVING]
    places: dict[str, list[Place]] = {}
    for discipline in disciplines:
        for place in standings(discipline, edition.entrants_of(discipline), rows):
            if place.decision_ms is not None and place.score.mean is not None:
                places.setdefault(place.entrant.name, []).append(place)
    whole = {name: own for name, own in places.items() if len(own) == len(disciplines)}
    return [_driver(one.name, whole[one.name]) for one in edition.entrants if one.name in whole]


def _driver(name: str, places: Sequence[Place]) -> Driver:
    count = len(places)
    scores = [place.score for place in places]
    halves = [((one.high or 0.0) - (one.low or 0.0)) / 2 for one in scores]  # disciplines are drawn apart
    times = math.exp(math.fsum(math.log(place.decision_ms or 1.0) for place in places) / count)
    return Driver(name, times, math.fsum(one.mean or 0.0 for one in scores) / count, math.hypot(*halves) / count)


def front(found: Sequence[Driver]) -> list[Driver]:
    """Drivers than whom nobody is faster and at least as good, the fastest first."""
    kept: list[Driver] = []
    for one in sorted(found, key=lambda one: one.decision_ms):
        if not kept or one.score > kept[-1].score:
            kept.append(one)
    return kept


def label_places(found: Sequence[Driver]) -> list[str]:
    """Where each name stands beside its point: where it covers points, the line and other names least."""
    points = [_pixel(one) for one in found]
    taken = [(x - 6, y - 8, x + 6, y + 8) for x, y in points]
    corners = [_pixel(one) for one in front(found)]
    taken += [(left, y - 1, right, y + 1) for (left, y), (right, _) in pairwise(corners)]
    chosen = []
    for one, (x, y) in zip(found, points, strict=True):
        wide, tall = 0.62 * LABEL_PX * len(one.name), 1.2 * LABEL_PX
        boxes = {
            "middle right": (x + 9, y - tall / 2, x + 9 + wide, y + tall / 2),
            "middle left": (x - 9 - wide, y - tall / 2, x - 9, y + tall / 2),
            "top center": (x - wide / 2, y - 9 - tall, x + wide / 2, y - 9),
            "bottom center": (x - wide / 2, y + 9, x + wide / 2, y + 9 + tall),
        }
        place = min(boxes, key=lambda name: sum(_shared(boxes[name], other) for other in taken))
        taken.append(boxes[place])
        chosen.append(place)
    return chosen


def _pixel(one: Driver) -> tuple[float, float]:
    """Where its point is drawn, from the top left of the axes, about."""
    low, high = (math.log10(end) for end in TIMES_MS)
    wide, tall = SIZE[0] - 160, SIZE[1] - 170
    share = (one.score - SCORES[0]) / (SCORES[1] - SCORES[0])
    return wide * (math.log10(one.decision_ms) - low) / (high - low), tall * (1 - share)


def _shared(one: Box, other: Box) -> float:
    """Area that two boxes share, square pixels."""
    wide = min(one[2], other[2]) - max(one[0], other[0])
    tall = min(one[3], other[3]) - max(one[1], other[1])
    return max(wide, 0.0) * max(tall, 0.0)


def profile_figure(edition: Edition, rows: Sequence[Row]) -> go.Figure:
    """Infractions per km of every driver, over all driving disciplines.

    Raises:
        InvalidInputError: No driving discipline has rows.
    """
    rates = profiles(edition, rows)
    if not rates:
        raise InvalidInputError("expected rows of a driving discipline, found none")
    kinds = [kind for kind in InfractionKind if any(rate[kind.value] >= FEWEST for rate in rates.values())]
    table = [[rate[kind.value] for kind in kinds] for rate in rates.values()]
    drawn = go.Figure(
        go.Heatmap(
            z=[[math.log10(max(rate, FEWEST / 2)) for rate in line] for line in table],
            x=[kind.specification.label for kind in kinds], y=[*rates],
            text=[[f"{rate:.2f}" if rate >= FEWEST / 2 else "" for rate in line] for line in table],
            texttemplate="%{text}", colorscale=[[0, PALETTES["light"].panel], [1, PALETTES["light"].infraction]],
            showscale=False, hoverinfo="skip",
        )
    )  # fmt: skip
    drawn.update_yaxes(autorange="reversed")
    return drawn.update_layout(
        template=template(), width=SIZE[0], height=140 + 34 * len(rates) + 90, margin_t=90,
        title={
            "text": "What each driver does wrong",
            "subtitle": {"text": "Infractions per km driven, over all driving disciplines; shades by the logarithm"},
        },
    )  # fmt: skip


def profiles(edition: Edition, rows: Sequence[Row]) -> Mapping[str, Mapping[str, float]]:
    """Infractions per km by kind, of every driver with rows."""
    disciplines = {one.name for one in edition.disciplines if one.family is Family.DRIVING}
    kept = [row for row in rows if row["benchmark"] in disciplines and not is_lost(row)]
    by_driver = {one.name: [row for row in kept if row["arm"] == one.name] for one in edition.entrants}
    return {name: infractions_per_km(own)[1] for name, own in by_driver.items() if own}


def main() -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=Path, default=PUBLISHED, help="folder of the rows")
    parser.add_argument("--edition", type=Path, default=DOCUMENT)
    parser.add_argument("--out", type=Path, default=Path("out/league"), help="folder of the pages")
    given = parser.parse_args()
    edition = read_edition(given.edition)
    rows = read_comparable_rows(edition, given.rows)
    for name, draw in (("league-speed", speed_figure), ("league-infractions", profile_figure)):
        for path in write_page(draw(edition, rows), given.out / f"{name}.html", "League"):
            print(f"figure: {path}")


if __name__ == "__main__":
    try:
        main()
    except DohyoError as error:
        sys.exit(f"league: {error}")
