"""Answers of the leaderboard and comparison routes. They describe plain JSON built elsewhere."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field

from dohyo.service.boards.leaderboard import Unranked
from dohyo.service.boards.ranking_views import RankingView
from dohyo.service.evaluations.metrics_views import EstimateView, SummaryView
from dohyo.service.evaluations.views import DohyoVersions
from dohyo.service.submissions.model import AgentKind
from dohyo.service.web.views import Version, View


class ComparisonView(View):
    """Paired difference of two sides over their common drives.

    Between the places of a board, a difference above 0 means a better score, also where lower scores are better.
    """

    difference: Annotated[EstimateView, Field(description="Mean of the differences.")]
    probability: Annotated[
        float | None,
        Field(
            description="Share of resamples in which the difference is above 0, and half of those in which it is 0; "
            "null below six drives, or where one to five of them differ."
        ),
    ]
    verdict: Annotated[
        Literal["<", "=", ">"],
        Field(description="< significantly below 0, > significantly above 0, = no significant difference."),
    ]


class RowView(View):
    """A place on the leaderboard: the run of a team (in an open ranking: of an agent) that counts."""

    rank: Annotated[
        int | None,
        Field(description="Shared by entries that do not differ significantly from its best; null: see `unranked`."),
    ]
    unranked: Annotated[
        Unranked | None,
        Field(
            description="Why it has no rank; null where it has one. other_version: another version of dohyo drove it "
            "than the runs with a rank, or several did; lost_too_many: it lost more than a tenth of its drives; "
            "low_throughput: fewer vehicles passed the bottleneck than its benchmark asks for; "
            "baseline: it is the organiser's."
        ),
    ]
    baseline: Annotated[bool, Field(description="Whether it is the organiser's, to compare with, without a rank.")]
    team: Annotated[str | None, Field(description="Name of the team; null outside of challenges.")]
    agent: Annotated[str, Field(description="Name of the agent.")]
    version: Annotated[int, Field(description="Version of the agent.")]
    submission: Annotated[str, Field(description="Identifier of the submission.")]
    evaluation: Annotated[str, Field(description="The run that counts.")]
    owner: Annotated[str, Field(description="Owner of the agent.")]
    kind: Annotated[AgentKind, Field(description="Kind of the submission.")]
    verified: Annotated[
        bool,
        Field(
            description="Whether the service itself ran the agent (built-in, ONNX). Of a remote agent, neither the "
            "computing time nor the memory nor the program can be checked."
        ),
    ]
    track: Annotated[str, Field(description="Which sensors the agent may use.")]
    dohyo_versions: DohyoVersions
    runs: Annotated[
        int, Field(description="Ranked runs of the entrant that were ordered, also failed and cancelled ones.")
    ]
    thrown_away: Annotated[int, Field(description="Attempts at episodes of these runs that gave no record.")]
    seeds: Annotated[int, Field(description="Number of seeds.")]
    episodes: Annotated[int, Field(description="Number of episodes that count.")]
    drives: Annotated[int, Field(description="Number of drives that count.")]
    lost: Annotated[int, Field(description="Drives lost to gridlocks, which are in no score.")]
    lost_too_many: Annotated[
        bool, Field(description="Whether it lost more than a tenth of its drives. Such a run has no rank.")
    ]
    finished: Annotated[datetime | None, Field(description="End of the run.")]
    scores: Annotated[dict[str, EstimateView], Field(description="Scores with intervals, by name.")]
    per_km: Annotated[dict[str, float], Field(description="Infractions per km; kinds that never happened left out.")]
    above: Annotated[
        ComparisonView | None,
        Field(
            description="This row against the one above, above 0 where it is better; null for the first, and where the "
            "two have no drive by the same version of dohyo in common."
        ),
    ]


class LeaderboardView(View):
    """A page of a ranking's board, best first."""

    benchmark: Annotated[str, Field(description="Name of the benchmark.", examples=["quickstart"])]
    version: Version
    versions: Annotated[list[Version], Field(description="Evaluated here, newest first.")]
    ranking: Annotated[RankingView | None, Field(description="The ranking; null where nothing was ranked yet.")]
    final: Annotated[bool, Field(description="Whether the board is final and never changes.")]
    track: Annotated[str | None, Field(description="The requested track; null: all, ranked as one.")]
    metric: Annotated[str, Field(description="The score that ranks.", examples=["driving_score"])]
    description: Annotated[str, Field(description="What that score is.")]
    total: Annotated[int, Field(description="Number of places on all pages.")]
    rows: Annotated[list[RowView], Field(description="The places of this page.")]
    next: Annotated[str | None, Field(description="To be given as `after`; null at the end.")]


class SideView(SummaryView):
    """One evaluation of a comparison."""

    evaluation: Annotated[str, Field(description="Identifier.")]
    agent: Annotated[str, Field(description="Name of the agent.")]
    version: Annotated[int, Field(description="Version of the agent.")]
    track: Annotated[str, Field(description="Which sensors the agent may use.")]
    seeds: Annotated[int, Field(description="Number of seeds.")]
    dohyo_versions: DohyoVersions


class PairView(View):
    """Two evaluations, score by score, a - b; null without drives in common."""

    a: Annotated[str, Field(description="Identifier of one evaluation.")]
    b: Annotated[str, Field(description="Identifier of the other one.")]
    scores: Annotated[dict[str, ComparisonView | None], Field(description="Comparison by score.")]


class ScenarioView(View):
    """A scenario with the score of each evaluation, in their order."""

    scenario: Annotated[str, Field(description="Name of the scenario.")]
    seed: Annotated[int, Field(description="Of the scenario.")]
    cell: Annotated[str, Field(description="Cell of the benchmark.")]
    spread: Annotated[float, Field(description="Largest value less the smallest.")]
    values: Annotated[list[float], Field(description="Headline score of each evaluation.")]
    driving_scores: Annotated[list[float], Field(description="Driving score of each evaluation.")]
    episodes: Annotated[list[str], Field(description="Episode of each evaluation.")]
    statuses: Annotated[list[list[str]], Field(description="How each ego's drive ended, for each evaluation.")]


class ComparedView(View):
    """Comparison of evaluations of one benchmark version."""

    benchmark: Annotated[str, Field(description="Name of the benchmark.")]
    benchmark_sha256: Version
    metric: Annotated[str, Field(description="The benchmark's headline score.")]
    evaluations: Annotated[list[SideView], Field(description="The sides, in the requested order.")]
    pairs: Annotated[list[PairView], Field(description="Each with each.")]
    scenarios: Annotated[list[ScenarioView], Field(description="Those on which they differ most.")]
