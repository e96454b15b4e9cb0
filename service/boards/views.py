"""Answers of the leaderboard and comparison routes. They describe plain JSON built elsewhere."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from dohyo.service.evaluations.metrics_views import EstimateView, SummaryView
from dohyo.service.web.views import Moment, Version, View


class ComparisonView(View):
    """Paired difference of two sides over their common drives."""

    difference: EstimateView
    probability: Annotated[float, Field(description="Share of resamples in which the difference is above 0.")]
    verdict: Annotated[Literal["<", "=", ">"], Field(description="= : the drives do not tell them apart.")]


class RowView(View):
    """A place on the leaderboard."""

    rank: Annotated[int, Field(description="Shared by entries that do not differ significantly from its best.")]
    agent: str
    version: int
    submission: str
    evaluation: str
    owner: str
    kind: str
    track: str
    seeds: int
    episodes: int
    drives: int
    finished: Moment | None
    scores: dict[str, EstimateView]
    per_km: Annotated[dict[str, float], Field(description="Infractions per km; kinds that never happened left out.")]
    above: Annotated[ComparisonView | None, Field(description="This row against the one above; null for the first.")]


class LeaderboardView(View):
    """Submissions on one version of a benchmark, best first."""

    benchmark: Annotated[str, Field(examples=["quickstart"])]
    version: Version
    versions: Annotated[list[Version], Field(description="Evaluated here, newest first.")]
    track: str | None
    metric: Annotated[str, Field(description="The score that ranks.", examples=["driving_score"])]
    description: Annotated[str, Field(description="What that score is.")]
    rows: list[RowView]


class SideView(SummaryView):
    """One evaluation of a comparison."""

    evaluation: str
    agent: str
    version: int
    track: str
    seeds: int


class PairView(View):
    """Two evaluations, score by score, a - b; null without drives in common."""

    a: str
    b: str
    scores: dict[str, ComparisonView | None]


class ScenarioView(View):
    """A scenario with the score of each evaluation, in their order."""

    scenario: str
    seed: int
    cell: str
    spread: Annotated[float, Field(description="Largest value less the smallest.")]
    values: list[float]
    driving_scores: list[float]
    episodes: list[str]
    statuses: list[list[str]]


class ComparedView(View):
    """Comparison of evaluations of one benchmark version."""

    benchmark: str
    benchmark_sha256: Version
    metric: str
    evaluations: list[SideView]
    pairs: list[PairView]
    scenarios: Annotated[list[ScenarioView], Field(description="Those on which they differ most.")]
