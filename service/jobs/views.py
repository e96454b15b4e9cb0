"""Answers of the job routes."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

from pydantic import Field

from dohyo.service.jobs.model import Job, JobStatus
from dohyo.service.web.views import Moment, Problem, View


class JobView(View):
    """Heavy work that was ordered; `GET /v1/jobs/{id}` follows it, `DELETE` cancels it."""

    id: Annotated[str, Field(description="Identifier of the job.", examples=["job-9f86d081884c7d65"])]
    kind: Annotated[str, Field(description="What is done.", examples=["onnx_submission"])]
    owner: Annotated[str, Field(description="Owner of the token that ordered it.", examples=["team-blue"])]
    status: Annotated[
        JobStatus,
        Field(description="`queued`, `running`; then `done`, `failed` (see `failure`) or `cancelled` for ever."),
    ]
    position: Annotated[
        int | None, Field(description="Queued jobs of all owners that were ordered before; null once it runs.")
    ]
    result: Annotated[
        str | None,
        Field(description="Path of what it made; null before its end.", examples=["/v1/agents/team-blue-mpc"]),
    ]
    answer: Annotated[
        dict[str, Any] | None, Field(description="The body that the order answers with `Prefer: wait`, once done.")
    ]
    failure: Annotated[Problem | None, Field(description="Why it failed, as the problem document of the order.")]
    created: Annotated[Moment, Field(description="When it was ordered.")]
    started: Annotated[datetime | None, Field(description="When its work began.")]
    finished: Annotated[datetime | None, Field(description="When it ended.")]


def view_job(job: Job, ahead: int | None) -> JobView:
    """View of a job; `ahead` is the number of jobs queued before it."""
    return JobView(
        id=job.id,
        kind=job.kind,
        owner=job.owner,
        status=job.status,
        position=ahead if job.status is JobStatus.QUEUED else None,
        result=job.result,
        answer=job.answer,
        failure=Problem.model_validate(job.problem) if job.problem else None,
        created=job.created,
        started=job.started,
        finished=job.finished,
    )
