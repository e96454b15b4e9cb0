"""Answers about one episode. They describe plain JSON built elsewhere."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from dohyo.service.episodes.views import EpisodeView
from dohyo.service.evaluations.views import DriverView
from dohyo.service.web.views import Version, View


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
    at_fault: Annotated[
        bool | None,
        Field(description="Whether the ego caused the collision; null of other kinds, and where it was never noted."),
    ] = None


class InfractionsView(View):
    """All infractions of an evaluation."""

    evaluation: str
    networks: list[str]
    infractions: list[InfractionView]


class EpisodeDetail(EpisodeView):
    """An episode with its agent and owner."""

    agent: Annotated[str, Field(description="Name of the agent.")]
    agent_version: Annotated[int, Field(description="Version of the agent.")]
    egos: Annotated[
        dict[str, DriverView],
        Field(description="Agents of single egos of a mixed run; empty: the agent drives all of them."),
    ]
    benchmark: Annotated[str, Field(description="Name of the benchmark.")]
    benchmark_version: Version
    rules: Annotated[str | None, Field(description="Of the driving score; null where no car is driven.")]
    network: Annotated[str | None, Field(description="Network of the scenario; null in lots and where withheld.")]


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


class WaitingView(View):
    """Explanations that a job is finding out."""

    episode: Annotated[str, Field(description="Identifier of the episode.")]
    tick: Annotated[int, Field(description="Tick that was asked for.")]
    status: Annotated[str, Field(description="For people.", examples=["being found out"])]
    job: Annotated[str, Field(description="Identifier of the job.", examples=["job-9f86d081884c7d65"])]
