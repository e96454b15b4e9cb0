"""Answers of the challenge routes."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Annotated, Any

from pydantic import Field

from dohyo.service.boards.ranking_views import RankingView
from dohyo.service.challenges.model import Challenge, Invitation, Team
from dohyo.service.submissions.model import AgentKind, Submission
from dohyo.service.web.views import Moment, View


class BaselineView(View):
    """A submission of the organiser that stands on the boards without a rank."""

    submission: Annotated[str, Field(description="Identifier of the submission.")]
    agent: Annotated[str, Field(description="Name of the agent.")]
    version: Annotated[int, Field(description="Version of the agent.")]
    kind: Annotated[AgentKind, Field(description="Kind of the submission.")]


class WinnerView(View):
    """A first place of a final board; several teams share it where they do not differ significantly."""

    team: Annotated[str | None, Field(description="Name of the team.")]
    agent: Annotated[str, Field(description="Name of the agent.")]
    version: Annotated[int, Field(description="Version of the agent.")]
    score: Annotated[float, Field(description="Mean of the headline score.")]


class AnnouncementView(View):
    """The final board of a phase, announced."""

    phase: Annotated[str, Field(description="Name of the phase.")]
    ranking: Annotated[str, Field(description="Identifier of the phase, for its board: `/v1/leaderboard?ranking=`.")]
    finalised: Moment
    places: Annotated[int, Field(description="Number of places on the final board.")]
    winners: Annotated[
        list[WinnerView] | None, Field(description="First places; null where the board is not shown to you.")
    ]


class ChallengeView(View):
    """A competition on this server."""

    name: Annotated[str, Field(description="Name, as in its address.", examples=["autumn-2026"])]
    title: Annotated[str, Field(description="Title, for people.")]
    rules: Annotated[str, Field(description="Rules: Markdown as it was sent; escape it before showing it.")]
    organiser: Annotated[str, Field(description="Owner who organises it.")]
    created: Moment
    phases: Annotated[list[RankingView], Field(description="Phases in the order of their closing.")]
    baselines: Annotated[list[BaselineView], Field(description="Submissions without a rank, to compare with.")]
    announcements: Annotated[list[AnnouncementView], Field(description="Final boards, the newest first.")]
    teams: Annotated[int, Field(description="Number of teams.")]
    my_team: Annotated[str | None, Field(description="Name of your team; null where you do not take part.")]
    may_organise: Annotated[bool, Field(description="Whether you may change this challenge.")]


class TeamView(View):
    """Owners who compete together."""

    name: Annotated[str, Field(description="Name of the team.")]
    members: Annotated[list[str], Field(description="Owners, in the order in which they joined.")]
    created: Moment


class InvitationView(View):
    """An invitation without its code."""

    id: Annotated[str, Field(description="Identifier.", examples=["in-9f86d081884c7d65"])]
    team: Annotated[str | None, Field(description="Team that it admits to; null: a new team of the bearer's choice.")]
    note: Annotated[str, Field(description="For the organiser, such as the person it is for.")]
    created: Moment
    expires: Moment
    revoked: Annotated[datetime | None, Field(description="Time of its revocation.")]
    redeemed: Annotated[datetime | None, Field(description="Time at which it was used.")]
    redeemed_by: Annotated[str | None, Field(description="Owner who used it.")]


class NewInvitation(InvitationView):
    """A new invitation; its code cannot be read again."""

    code: Annotated[str, Field(description="To be given to one participant; admits once.")]


class RedeemedView(View):
    """A redeemed invitation."""

    challenge: Annotated[str, Field(description="Name of the challenge.")]
    team: Annotated[str, Field(description="Name of the team.")]
    owner: Annotated[str, Field(description="Owner who now takes part.")]
    token: Annotated[
        str | None,
        Field(description="Secret of a new submitter's token, shown once; null where a token was sent."),
    ]


def view_challenge(
    challenge: Challenge,
    phases: Sequence[RankingView],
    baselines: Sequence[tuple[Submission, str]],
    announcements: Sequence[AnnouncementView],
    **seen: Any,
) -> ChallengeView:
    """A challenge, as one caller sees it."""
    return ChallengeView(
        name=challenge.name,
        title=challenge.title,
        rules=challenge.rules,
        organiser=challenge.owner,
        created=challenge.created,
        phases=list(phases),
        baselines=[view_baseline(*one) for one in baselines],
        announcements=list(announcements),
        **seen,
    )


def view_baseline(submission: Submission, agent: str) -> BaselineView:
    """A baseline."""
    return BaselineView(submission=submission.id, agent=agent, version=submission.version, kind=submission.kind)


def view_team(team: Team, members: Sequence[str]) -> TeamView:
    """A team with its members."""
    return TeamView(name=team.name, members=list(members), created=team.created)


def view_invitation(invitation: Invitation) -> InvitationView:
    """An invitation without its code."""
    return InvitationView.model_validate(invitation, from_attributes=True)
