"""Views of the reading routes: standings, comparisons, metrics, scores. They describe plain JSON built elsewhere."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from dohyo.service.views import EpisodeView, Moment, Version, View


class EstimateView(View):
    """A number with its 95 % interval; null where there are too few values."""

    mean: Annotated[float | None, Field(examples=[71.4])]
    low: Annotated[float | None, Field(examples=[66.0])]
    high: Annotated[float | None, Field(examples=[76.2])]
    n: Annotated[int, Field(description="Number of values.", examples=[18])]


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


ScoresLostAsZero = Annotated[
    dict[str, EstimateView] | None,
    Field(description="The same with every lost drive counting 0; null where none was lost."),
]


class SummaryView(View):
    """Scores of drives; lost ones are left out, except where the name says otherwise."""

    drives: int
    episodes: int
    lost: Annotated[int, Field(description="Drives lost to gridlocks and infrastructure faults.")]
    km: float
    scores: dict[str, EstimateView]
    scores_lost_as_zero: ScoresLostAsZero
    per_km: dict[str, EstimateView]
    statuses: dict[str, int]


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


class MetricsView(View):
    """An evaluation as a whole, by cell and by drive."""

    evaluation: str
    agent: str
    version: int
    benchmark: str
    benchmark_sha256: Version
    seeds: list[int]
    all: SummaryView
    cells: dict[str, SummaryView]
    drives: Annotated[list[dict[str, Any]], Field(description="Scores and counts of each drive.")]


class InfractionView(View):
    """One infraction of an evaluation, with its place on the network, m."""

    kind: str
    time_s: float
    x_m: float
    y_m: float
    route_m: float
    network: str
    episode: str
    scenario: str
    cell: str
    seed: int
    ego: str


class InfractionsView(View):
    """All infractions of an evaluation."""

    evaluation: str
    networks: list[str]
    infractions: list[InfractionView]


class RescoredView(View):
    """An evaluation under other rules."""

    agent: str
    benchmark: str | None
    benchmark_hash: str | None
    rules: str
    irs_length: str
    irs_lambda: float
    episodes: int
    lost: int
    km: float
    scores: dict[str, EstimateView]
    scores_lost_as_zero: ScoresLostAsZero
    per_km: dict[str, EstimateView]
    statuses: dict[str, int]
    cells: dict[str, Any]
    drives: list[dict[str, Any]]


class EpisodeDetail(EpisodeView):
    """An episode with its agent and owner."""

    agent: str
    agent_version: int
    benchmark: str
    benchmark_version: Version
    rules: Annotated[str, Field(description="Of the driving score.")]
    network: str


class EventsView(View):
    """The infractions of an episode."""

    episode: str
    rules: str
    egos: Annotated[list[dict[str, Any]], Field(description="Name, status, failure, infractions of each.")]


class VerificationView(View):
    """A recorded episode driven again."""

    episode: str
    expected: Annotated[str, Field(description="Hash of the record.")]
    replayed: Annotated[str, Field(description="Hash of the new one.")]
    same: bool


class ExplanationView(View):
    """Explanations of the agent's decisions at one tick, by ego; null without an explanation."""

    episode: str
    tick: int
    ticks: int
    explanations: dict[str, Any]
