"""Answers of the cross-play route."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from dohyo.service.evaluations.metrics_views import EstimateView
from dohyo.service.submissions.model import AgentKind
from dohyo.service.web.views import Version, View


class CrossPlayScoreView(View):
    """Headline score of an agent beside others."""

    score: Annotated[EstimateView, Field(description="Mean over its drives; null where all of them were lost.")]
    drives: Annotated[int, Field(description="Number of its drives, without those that were driven again.")]
    episodes: Annotated[int, Field(description="Number of their episodes.")]
    lost: Annotated[int, Field(description="Drives lost to gridlocks, which are in no mean.")]


class CrossPlayAgentView(CrossPlayScoreView):
    """An agent of mixed runs, with its score over all of its drives in them."""

    submission: Annotated[str, Field(description="Identifier of the submission.")]
    agent: Annotated[str, Field(description="Name of the agent.")]
    version: Annotated[int, Field(description="Version of the agent.")]
    owner: Annotated[str, Field(description="Owner of the agent.")]
    kind: Annotated[AgentKind, Field(description="Kind of the submission.")]
    track: Annotated[str, Field(description="Which sensors the agent may use.")]


class CrossPlayCellView(CrossPlayScoreView):
    """The score of one agent in episodes with another one."""

    submission: Annotated[str, Field(description="The agent whose drives are scored.")]
    other: Annotated[
        str, Field(description="The agent that it met; the same: its runs with copies of itself in all egos.")
    ]


class CrossPlayView(View):
    """Agents of a benchmark beside each other, in the complete mixed runs that the caller may read."""

    benchmark: Annotated[str, Field(description="Name of the benchmark.", examples=["fleet"])]
    version: Version
    versions: Annotated[list[Version], Field(description="Evaluated here, newest first.")]
    metric: Annotated[str, Field(description="The score.", examples=["driving_score"])]
    description: Annotated[str, Field(description="What that score is.")]
    runs: Annotated[int, Field(description="Number of mixed runs that count.")]
    dohyo_version: Annotated[
        str | None, Field(description="The version of dohyo that drove them; null: no mixed run is of one version.")
    ]
    other_versions: Annotated[int, Field(description="Mixed runs of other versions, which do not count.")]
    agents: Annotated[list[CrossPlayAgentView], Field(description="The best first.")]
    cells: Annotated[list[CrossPlayCellView], Field(description="Pairs that met; others have no cell.")]
