"""Answer of the league's route."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from dohyo.evaluation.families import Family
from dohyo.service.evaluations.metrics_views import EstimateView
from dohyo.service.web.views import View


class LeagueMeasureView(View):
    """A measure of a discipline."""

    key: Annotated[str, Field(description="Name of the measure.", examples=["driving_score"])]
    title: Annotated[str, Field(description="Name for people, with its unit.")]
    lower: Annotated[bool, Field(description="Whether lower values are better.")]


class LeaguePlaceView(View):
    """An entrant in a discipline."""

    entrant: Annotated[str, Field(description="Name of the entrant.")]
    system: Annotated[str, Field(description="What it is, in a few words.")]
    thesis: Annotated[str | None, Field(description="Thesis whose system it is: A, B or C.")]
    parameters: Annotated[int, Field(description="Number of learned parameters.")]
    leads: Annotated[bool, Field(description="Whether it is first, or not significantly behind the first.")]
    scores: Annotated[
        dict[str, EstimateView], Field(description="Estimates of the discipline's measures; the first one ranks.")
    ]
    better_than: Annotated[list[str], Field(description="Entrants that are significantly worse.")]
    counted: Annotated[int, Field(description="Number of drives, lots, days or mornings.")]
    lost: Annotated[int, Field(description="How many were lost, and are in no mean.")]
    decision_ms: Annotated[float | None, Field(description="Median time of a decision on the league's machine, ms.")]
    reported: Annotated[str | None, Field(description="What its source reports, measured elsewhere.")]


class LeagueDisciplineView(View):
    """A part of a benchmark on seeds of its own."""

    name: Annotated[str, Field(description="Name of the discipline.")]
    title: Annotated[str, Field(description="Name for people.")]
    told: Annotated[str, Field(description="What it consists of.")]
    benchmark: Annotated[str, Field(description="Name of the benchmark.")]
    family: Annotated[Family, Field(description="What its entrants move.")]
    measures: Annotated[list[LeagueMeasureView], Field(description="What is measured; the first one ranks.")]
    places: Annotated[list[LeaguePlaceView], Field(description="The best first; empty: not driven so far.")]


class LeagueView(View):
    """Dohyo's own systems in parts of benchmarks, on seeds that were fixed before the first drive."""

    edition: Annotated[str, Field(description="Year and month of the edition.", examples=["2027-01"])]
    versions: Annotated[list[str], Field(description="Versions of dohyo that drove its rows.", examples=[["0.1.0"]])]
    told: Annotated[str, Field(description="What the edition is.")]
    looked_at: Annotated[
        list[str], Field(description="Which of its seeds had been looked at, or led to changes; empty: none.")
    ]
    disciplines: Annotated[list[LeagueDisciplineView], Field(description="In the order of the edition.")]
