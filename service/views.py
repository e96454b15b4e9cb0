"""Views: the answers of the routes, one model per resource."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.service.database.models import (
    Agent,
    AgentKind,
    Episode,
    EpisodeStatus,
    Evaluation,
    EvaluationStatus,
    Role,
    Submission,
    Token,
    Webhook,
)

T = TypeVar("T")
Version = Annotated[str, Field(description="Content hash.", examples=["4f0c" * 16])]
Moment = Annotated[datetime, Field(examples=["2026-01-31T12:00:00Z"])]


class View(BaseModel):
    """Base of all answers."""

    model_config = ConfigDict(frozen=True)


class Problem(View):
    """An error (RFC 9457), as `application/problem+json`."""

    type: str = "about:blank"
    title: Annotated[str, Field(examples=["Not Found"])]
    status: Annotated[int, Field(examples=[404])]
    detail: Annotated[str, Field(examples=["no benchmark named 'quickstat'; did you mean 'quickstart'?"])]
    errors: list[dict[str, str]] | None = None


class Page(View, Generic[T]):
    """A page of items with the cursor of the next page."""

    items: list[T]
    next: Annotated[str | None, Field(description="To be given as `after`; null at the end.")] = None


class TokenView(View):
    """A token without its secret."""

    id: Annotated[str, Field(examples=["tok-9f86d081884c7d65"])]
    owner: Annotated[str, Field(examples=["team-blue"])]
    role: Role
    created: Moment
    expires: datetime | None
    revoked: datetime | None


class NewToken(TokenView):
    """A new token; its secret cannot be read again."""

    token: Annotated[str, Field(examples=["dohyo_7Zl3..."])]


class MeView(View):
    """Owner and role of the sent token."""

    owner: str
    role: Role
    token: str


class NetworkView(View):
    """A road network."""

    name: Annotated[str, Field(examples=["ingolstadt"])]
    title: str
    licence: str
    source: str
    origin: Annotated[Literal["dohyo", "upload"], Field(description="Whether it came with dohyo.")]
    sha256: Version
    lanes: Annotated[int, Field(description="For cars, outside junctions.")]
    lane_km: float
    lights: int
    crossings: int
    bounds: Annotated[list[float], Field(description="x0, y0, x1, y1 in metres.", min_length=4, max_length=4)]


class BenchmarkView(View):
    """The current version of a benchmark; the version is a content hash."""

    name: Annotated[str, Field(examples=["quickstart"])]
    version: Version
    description: str
    headline: Annotated[Headline, Field(description="The score that ranks agents.")]
    metric: Annotated[str, Field(description="How that score is computed, in words.")]
    rules: Annotated[str, Field(description="Of the driving score.")]
    networks: list[str]
    cells: list[str]
    scenarios: Annotated[int, Field(description="Per seed.")]
    seeds: Annotated[list[int], Field(description="Driven by default.")]


class BenchmarkVersionView(View):
    """A version of a benchmark that was or can be evaluated on this server."""

    version: Version
    current: Annotated[bool, Field(description="Whether new evaluations use it.")]
    first_evaluated: datetime | None
    evaluations: int


class AgentView(View):
    """A named line of submissions."""

    name: Annotated[str, Field(examples=["team-blue-mpc"])]
    owner: str
    description: str
    created: Moment
    version: Annotated[int | None, Field(description="Of the latest submission; null without one.")]
    kind: AgentKind | None
    track: str | None


class SubmissionView(View):
    """One version of an agent; never changes."""

    id: str
    agent: str
    version: Annotated[int, Field(examples=[1])]
    kind: AgentKind
    name: Annotated[str, Field(description="As records call it.")]
    track: str
    sensors: list[str]
    control: str
    entry: str
    source_sha256: str
    settings: dict[str, Any]
    policy_sha256: str | None
    created: Moment


class Progress(View):
    """Numbers of an evaluation's episodes by status."""

    total: int
    done: int = 0
    running: int = 0
    queued: int = 0
    lost: int = 0
    cancelled: int = 0


class EvaluationView(View):
    """One submission on one version of a benchmark."""

    id: Annotated[str, Field(examples=["ev-9f86d081884c7d65"])]
    owner: str
    agent: str
    version: Annotated[int, Field(description="Of the agent.")]
    kind: AgentKind
    track: str
    benchmark: str
    benchmark_version: Version
    seeds: list[int]
    slow_policy: str
    act_deadline_s: float
    status: EvaluationStatus
    failure: str | None
    progress: Progress
    created: Moment
    started: datetime | None
    finished: datetime | None


class EpisodeView(View):
    """One scenario of an evaluation."""

    id: Annotated[str, Field(examples=["ep-9f86d081884c7d65"])]
    evaluation: str
    position: Annotated[int, Field(description="In the benchmark's order, from 0.")]
    scenario: str
    cell: str
    seed: int
    status: EpisodeStatus
    attempts: int
    record_hash: str | None
    summary: Annotated[dict[str, Any] | None, Field(description="Scores and counts per ego, from the record.")]
    failure: str | None
    started: datetime | None
    finished: datetime | None


class WebhookView(View):
    """A URL for an owner's messages at the end of evaluations."""

    id: str
    url: Annotated[str, Field(examples=["https://example.org/hook"])]
    created: Moment


class NewWebhook(WebhookView):
    """A new webhook; its secret cannot be read again."""

    secret: Annotated[str, Field(description="Key of the signature in `Dohyo-Signature`.")]


def view_token(token: Token) -> TokenView:
    """View of a token without its secret."""
    return TokenView.model_validate(token, from_attributes=True)


def view_agent(agent: Agent, latest: Submission | None) -> AgentView:
    """An agent and its latest submission."""
    return AgentView(
        name=agent.name,
        owner=agent.owner,
        description=agent.description,
        created=agent.created,
        version=latest.version if latest else None,
        kind=latest.kind if latest else None,
        track=latest.track if latest else None,
    )


def view_submission(submission: Submission, agent: str) -> SubmissionView:
    """A submission of an agent."""
    info = submission.info
    return SubmissionView(
        id=submission.id,
        agent=agent,
        version=submission.version,
        kind=submission.kind,
        name=info["name"],
        track=submission.track,
        sensors=info["sensors"],
        control=info["control"],
        entry=info["entry"],
        source_sha256=info["source_sha256"],
        settings=info["settings"],
        policy_sha256=submission.policy_sha256,
        created=submission.created,
    )


def view_evaluation(
    evaluation: Evaluation, agent: str, benchmark: str, counts: Mapping[EpisodeStatus, int]
) -> EvaluationView:
    """An evaluation and its episodes by status."""
    submission = evaluation.submission
    progress = {status.value: count for status, count in counts.items()}
    return EvaluationView(
        id=evaluation.id,
        owner=evaluation.owner,
        agent=agent,
        version=submission.version,
        kind=submission.kind,
        track=submission.track,
        benchmark=benchmark,
        benchmark_version=evaluation.benchmark_sha256,
        seeds=evaluation.seeds,
        slow_policy=evaluation.slow_policy,
        act_deadline_s=evaluation.act_deadline_s,
        status=evaluation.status,
        failure=evaluation.failure,
        progress=Progress(total=sum(counts.values()), **progress),
        created=evaluation.created,
        started=evaluation.started,
        finished=evaluation.finished,
    )


def view_episode(episode: Episode) -> EpisodeView:
    """An episode."""
    return EpisodeView(
        evaluation=episode.evaluation_id,
        **{name: getattr(episode, name) for name in EpisodeView.model_fields if name != "evaluation"},
    )


def view_webhook(webhook: Webhook) -> WebhookView:
    """A webhook, without its secret."""
    return WebhookView(id=webhook.id, url=webhook.url, created=webhook.created)
