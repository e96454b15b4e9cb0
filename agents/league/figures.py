"""Figures of the league: score against the time of a decision, and infractions per km.

    python -m dohyo.agents.league.figures --out out/league

Writes pages that need no network, and pictures beside them if chromium is installed.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from dohyo.agents.league.edition import DOCUMENT, PUBLISHED, Edition, read_edition
from dohyo.agents.league.measures import MEASURES
from dohyo.agents.league.rows import read_comparable_rows
from dohyo.agents.league.standings import Place, standings
from dohyo.agents.studies.rows import Row, infractions_per_km, is_lost
from dohyo.evaluation.families import Family
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.report.pictures import write_page
from dohyo.evaluation.report.style import PALETTES, agent_colours, template
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError

SIZE: Final = (980, 420)
SECTION: Final = """## What each driver does wrong

![Infractions per km of each driver, by kind](pictures/league-infractions.png)

Over all driving disciplines; `python -m dohyo.agents.league.figures --out docs/pictures` draws it."""
"""Where the picture of the infractions stands on the page of the published edition."""
FEWEST: Final = 0.02
"""Rate below which a kind of infraction is left out, per km."""


def speed_figure(edition: Edition, rows: Sequence[Row]) -> go.Figure:
    """Headline against the time of a decision, a panel per driving discipline; the line joins who is not dominated.

    Raises:
        InvalidInputError: No driving discipline has rows.
    """
    driven = {
        one.title: (MEASURES[one.headline].title, places)
        for one in edition.disciplines
        if one.family is Family.DRIVING and (places := standings(one, edition.entrants_of(one), rows))
    }
    if not driven:
        raise InvalidInputError("expected rows of a driving discipline, found none")
    columns = min(3, len(driven))
    lines = math.ceil(len(driven) / columns)
    drawn = make_subplots(lines, columns, subplot_titles=[*driven], vertical_spacing=0.16)
    colours = agent_colours(one.name for one in edition.entrants if one.family is Family.DRIVING)
    for number, (head, places) in enumerate(driven.values()):
        line, column = number // columns + 1, number % columns + 1
        _front(drawn, places, line, column)
        for place in places:
            _point(drawn, place, colours[place.entrant.name], line, column)
        drawn.update_yaxes(title=head, range=[-4, 104], row=line, col=column)
        drawn.update_xaxes(type="log", title="ms of a decision" if line == lines else None, row=line, col=column)
    return drawn.update_layout(
        template=template(), showlegend=False, width=SIZE[0], height=SIZE[1] * lines, margin_t=90,
        title={
            "text": "What a decision costs, and what it earns",
            "subtitle": {"text": "Median time on one machine; 95 % intervals; line: nobody is faster and better"},
        },
    )  # fmt: skip


def front(places: Sequence[Place]) -> list[Place]:
    """Places than which nobody is faster and at least as good, the fastest first."""
    measured = [one for one in places if one.decision_ms is not None and one.score.mean is not None]
    timed = sorted(measured, key=lambda one: one.decision_ms or 0.0)
    kept: list[Place] = []
    for place in timed:
        if not kept or (place.score.mean or 0.0) > (kept[-1].score.mean or 0.0):
            kept.append(place)
    return kept


def _front(drawn: go.Figure, places: Sequence[Place], line: int, column: int) -> None:
    best = front(places)
    drawn.add_scatter(
        x=[one.decision_ms for one in best], y=[one.score.mean for one in best], mode="lines", hoverinfo="skip",
        line={"color": PALETTES["light"].quiet, "width": 1, "dash": "dot", "shape": "hv"}, row=line, col=column,
    )  # fmt: skip


def _point(drawn: go.Figure, place: Place, colour: str, line: int, column: int) -> None:
    score = place.score
    if place.decision_ms is None or score.mean is None:
        return
    high, low = (0.0 if end is None else abs(end - score.mean) for end in (score.high, score.low))
    drawn.add_scatter(
        x=[place.decision_ms], y=[score.mean], mode="markers+text", text=[place.entrant.name],
        textposition="bottom center", textfont={"size": 11}, marker={"color": colour, "size": 9},
        error_y={"array": [high], "arrayminus": [low], "thickness": 1, "width": 3}, row=line, col=column,
    )  # fmt: skip


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
