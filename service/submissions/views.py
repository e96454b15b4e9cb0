"""Answers of the agent and submission routes."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from dohyo.service.submissions.model import Agent, AgentKind, Submission
from dohyo.service.web.views import Moment, View


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
    files_sha256: str
    settings: dict[str, Any]
    policy_sha256: str | None
    created: Moment


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
        files_sha256=info["files_sha256"],
        settings=info["settings"],
        policy_sha256=submission.policy_sha256,
        created=submission.created,
    )
