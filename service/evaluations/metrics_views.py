"""Answers of the metrics and rescoring routes. They describe plain JSON built elsewhere."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from dohyo.service.submissions.model import AgentKind
from dohyo.service.web.views import Version, View


class EstimateView(View):
    """A number with its 95 % interval; null where there are too few values."""

    mean: Annotated[float | None, Field(examples=[71.4])]
    low: Annotated[float | None, Field(examples=[66.0])]
    high: Annotated[float | None, Field(examples=[76.2])]
    n: Annotated[int, Field(description="Number of values.", examples=[18])]


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


class AgentSummaryView(SummaryView):
    """Scores of one agent of a mixed run, over its own drives."""

    agent: Annotated[str, Field(description="Name of the agent.")]
    version: Annotated[int, Field(description="Of the agent.")]
    submission: Annotated[str, Field(description="Identifier of the submission.")]
    kind: Annotated[AgentKind, Field(description="Kind of the submission.")]
    track: Annotated[str, Field(description="Which sensors the agent may use.")]
    egos: Annotated[list[str], Field(description="Egos that it drove.")]


class AgentVersionView(View):
    """A version of an agent."""

    agent: Annotated[str, Field(description="Name of the agent.")]
    version: Annotated[int, Field(description="Of the agent.")]


class MeetingView(View):
    """Two agents of a mixed run that drove in the same episodes."""

    agents: Annotated[list[AgentVersionView], Field(description="The two.")]
    episodes: Annotated[int, Field(description="Episodes with egos of both.")]
    collisions: Annotated[
        int, Field(description="Collisions between their egos; one counts twice where both egos moved.")
    ]


class MetricsView(View):
    """An evaluation as a whole, by cell and by drive; a mixed run also by agent."""

    evaluation: str
    agent: str
    version: int
    benchmark: str
    benchmark_sha256: Version
    seeds: list[int]
    all: Annotated[SummaryView, Field(description="Over all drives, in a mixed run those of all agents.")]
    agents: Annotated[
        list[AgentSummaryView], Field(description="Each agent of a mixed run; empty: one agent drove all egos.")
    ]
    meetings: Annotated[list[MeetingView], Field(description="Agents of a mixed run that met.")]
    cells: dict[str, SummaryView]
    drives: Annotated[list[dict[str, Any]], Field(description="Scores and counts of each drive.")]


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
