"""Answers of the evaluation routes."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated

from pydantic import Field

from dohyo.service.evaluations.model import EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.submissions.model import AgentKind
from dohyo.service.web.views import Moment, Version, View


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
