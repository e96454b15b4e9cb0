"""Answers of the evaluation routes."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated

from pydantic import Field

from dohyo.service.evaluations.model import EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.submissions.model import AgentKind
from dohyo.service.web.views import Moment, Version, View

DohyoVersions = Annotated[
    list[str],
    Field(
        description="Versions of dohyo that drove its episodes, usually one; `earlier` stands for those of before the "
        "service noted them.",
        examples=[["0.2.0"]],
    ),
]


class Progress(View):
    """Numbers of an evaluation's episodes by status."""

    total: Annotated[int, Field(description="All episodes.")]
    done: Annotated[int, Field(description="Episodes with a record, also of a gridlock, which counts in no score.")] = 0
    running: Annotated[int, Field(description="Episodes that drive now.")] = 0
    queued: Annotated[int, Field(description="Episodes that wait.")] = 0
    lost: Annotated[int, Field(description="Episodes without a record, lost to faults of the infrastructure.")] = 0
    cancelled: Annotated[int, Field(description="Episodes that were cancelled before they ended.")] = 0


class DriverView(View):
    """The agent of an ego."""

    agent: Annotated[str, Field(description="Name of the agent.")]
    version: Annotated[int, Field(description="Of the agent.")]
    submission: Annotated[str, Field(description="Identifier of the submission.")]
    kind: Annotated[AgentKind, Field(description="Kind of the submission.")]
    track: Annotated[str, Field(description="Which sensors the agent may use.")]


class EvaluationView(View):
    """One submission on one version of a benchmark, or several in a mixed run: a ranked run or a practice run."""

    id: Annotated[str, Field(description="Identifier.", examples=["ev-9f86d081884c7d65"])]
    owner: Annotated[str, Field(description="Owner of the run.")]
    agent: Annotated[str, Field(description="Name of the agent.")]
    version: Annotated[int, Field(description="Of the agent.")]
    kind: Annotated[AgentKind, Field(description="Kind of the submission.")]
    track: Annotated[str, Field(description="Which sensors the agent may use.")]
    egos: Annotated[
        dict[str, DriverView],
        Field(description="Agents of single egos of a mixed run; empty: the agent drives all of them."),
    ]
    benchmark: Annotated[str, Field(description="Name of the benchmark.")]
    benchmark_version: Version
    dohyo_versions: DohyoVersions
    ranking: Annotated[str | None, Field(description="Ranking that the run enters; null: a practice run.")]
    seeds: Annotated[list[int] | None, Field(description="Driven seeds; null where they are withheld.")]
    slow_policy: Annotated[str, Field(description="Whether the simulation waits for a remote agent.")]
    act_deadline_s: Annotated[float, Field(description="Wall-clock time for one decision, s.")]
    status: Annotated[EvaluationStatus, Field(description="Status; done: every episode has a record.")]
    failure: Annotated[
        str | None,
        Field(
            description="Why it failed, or has no score although it is done: all of its episodes were gridlocked. Null "
            "where neither holds, or where it is withheld."
        ),
    ]
    withheld: Annotated[
        bool, Field(description="Whether seeds, scenarios, records and failures are not shown to you (now).")
    ]
    progress: Annotated[Progress, Field(description="Episodes by status.")]
    created: Moment
    started: Annotated[datetime | None, Field(description="Start of its first episode.")]
    finished: Annotated[datetime | None, Field(description="End of its last episode.")]


def view_egos(evaluation: Evaluation) -> dict[str, DriverView]:
    """Agents of the egos that the evaluation's own does not drive."""
    return {
        one.ego: DriverView(
            agent=one.submission.agent.name,
            version=one.submission.version,
            submission=one.submission_id,
            kind=one.submission.kind,
            track=one.submission.track,
        )
        for one in evaluation.egos
    }


def view_evaluation(
    evaluation: Evaluation, agent: str, benchmark: str, counts: Mapping[EpisodeStatus, int], *, told: bool = True
) -> EvaluationView:
    """An evaluation and its episodes by status.

    Args:
        evaluation: The evaluation.
        agent: Name of its agent.
        benchmark: Name of its benchmark.
        counts: Its episodes by status.
        told: Whether the reader may see its records, and so also seeds and failure.
    """
    submission = evaluation.submission
    progress = {status.value: count for status, count in counts.items()}
    return EvaluationView(
        id=evaluation.id,
        owner=evaluation.owner,
        agent=agent,
        version=submission.version,
        kind=submission.kind,
        track=submission.track,
        egos=view_egos(evaluation),
        benchmark=benchmark,
        benchmark_version=evaluation.benchmark_sha256,
        dohyo_versions=evaluation.dohyo_versions,
        ranking=evaluation.ranking_id,
        seeds=evaluation.seeds if told else None,
        slow_policy=evaluation.slow_policy,
        act_deadline_s=evaluation.act_deadline_s,
        status=evaluation.status,
        failure=evaluation.failure if told else None,
        withheld=not told,
        progress=Progress(total=sum(counts.values()), **progress),
        created=evaluation.created,
        started=evaluation.started,
        finished=evaluation.finished,
    )
