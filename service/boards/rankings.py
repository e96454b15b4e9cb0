"""Rankings: found, made, and the conditions under which a run enters one."""

from __future__ import annotations

import logging
from datetime import datetime, timedelta
from typing import Final

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from dohyo.service.accounts.access import Caller
from dohyo.service.benchmarks.catalog import AnyBenchmark
from dohyo.service.boards.model import Counts, Ranking
from dohyo.service.boards.ranking_views import RankingView, view_ranking
from dohyo.service.challenges.model import Baseline, Challenge, Member
from dohyo.service.database.base import now
from dohyo.service.errors import ConflictError, ForbiddenError, NotFoundError, TooManyRequestsError
from dohyo.service.evaluations.access import ranking_seen_by
from dohyo.service.evaluations.model import BenchmarkVersion, Evaluation
from dohyo.service.evaluations.queries import save_benchmark
from dohyo.service.settings import Settings
from dohyo.service.submissions.model import AgentKind, Submission

DAY_S: Final = 86_400.0

logger = logging.getLogger("dohyo.challenges")


def open_ranking_id(benchmark_sha256: str) -> str:
    """Identifier of the open ranking of a benchmark version."""
    return f"rk-{benchmark_sha256[:16]}"


def open_ranking(session: Session, benchmark: AnyBenchmark, settings: Settings) -> Ranking:
    """The open ranking of a benchmark version, made at its first use.

    Seeds and deadline are fixed from then on; the number of runs per day follows the settings. `serialise` first.
    """
    ranking = session.get(Ranking, open_ranking_id(benchmark.sha256))
    if ranking is None:
        ranking = Ranking(
            id=open_ranking_id(benchmark.sha256),
            benchmark_sha256=save_benchmark(session, benchmark).sha256,
            seeds=list(benchmark.seeds),
            act_deadline_s=settings.act_deadline_s,
            runs_per_period=settings.runs_per_day,
            period_s=DAY_S,
            counts=Counts.FIRST,
        )
        session.add(ranking)
        session.flush()
    ranking.runs_per_period = settings.runs_per_day
    return ranking


def ranking_for(session: Session, caller: Caller, ranking_id: str) -> tuple[Ranking, RankingView]:
    """A ranking, and what a caller may know of it. That it exists, with its conditions, is no secret; its seeds may be.

    Raises:
        NotFoundError: There is none.
    """
    shown = ranking_seen_by(caller)
    query = (
        select(Ranking, BenchmarkVersion.name, Challenge, shown)
        .join(BenchmarkVersion, BenchmarkVersion.sha256 == Ranking.benchmark_sha256)
        .outerjoin(Challenge, Challenge.id == Ranking.challenge_id)
        .where(Ranking.id == ranking_id)
    )
    row = session.execute(query).one_or_none()
    if row is None:
        raise NotFoundError(f"no ranking '{ranking_id}'")
    ranking, benchmark, challenge, visible = row
    told = caller.is_admin or (challenge is not None and caller.organises(challenge.owner))
    name = challenge.name if challenge else None
    return ranking, view_ranking(ranking, benchmark, name, at=now(), told=told, board_visible=bool(visible))


def team_of(session: Session, ranking: Ranking, owner: str) -> str | None:
    """Identifier of an owner's team in the challenge of a phase; None without one."""
    if ranking.challenge_id is None:
        return None
    member = session.get(Member, (ranking.challenge_id, owner))
    return member.team_id if member else None


def is_baseline(session: Session, ranking: Ranking, submission: Submission) -> bool:
    """Whether a submission is a baseline of the phase's challenge."""
    if ranking.challenge_id is None:
        return False
    return session.get(Baseline, (ranking.challenge_id, submission.id)) is not None


def check_entry(session: Session, ranking: Ranking, submission: Submission, at: datetime | None = None) -> str | None:
    """Checks that a run of a submission may be ordered now.

    Call it in the transaction that adds the run, after `serialise`, so that runs ordered at the same time are counted.

    Returns:
        Identifier of the team that the run counts for; None in an open ranking, and for a baseline.

    Raises:
        ConflictError: The ranking is not open now.
        ForbiddenError: The submission may not enter: no team, another track, or not verified.
        TooManyRequestsError: The entrant has used the runs of the period.
    """
    at = at or now()
    if ranking.opens is not None and at < ranking.opens:
        raise ConflictError(f"phase '{ranking.name}' opens at {ranking.opens:%Y-%m-%d %H:%M:%S} UTC")
    if ranking.closes is not None and at >= ranking.closes:
        raise ConflictError(f"phase '{ranking.name}' closed at {ranking.closes:%Y-%m-%d %H:%M:%S} UTC")
    if ranking.track is not None and submission.track != ranking.track:
        raise ForbiddenError(
            f"phase '{ranking.name}' takes submissions on track '{ranking.track}', yours is on '{submission.track}'"
        )
    if ranking.verified_only and submission.kind is AgentKind.REMOTE:
        raise ForbiddenError(f"phase '{ranking.name}' takes agents that the service runs, yours is remote")
    team = team_of(session, ranking, submission.agent.owner)
    if ranking.challenge_id is not None and team is None and not is_baseline(session, ranking, submission):
        raise ForbiddenError(
            f"the owner of agent '{submission.agent.name}' is in no team of this challenge; redeem an invitation first"
        )
    _check_quota(session, ranking, submission, team, at)
    reopen(ranking, at)
    return team


def reopen(ranking: Ranking, at: datetime | None = None) -> None:
    """Takes back that a board is final where the phase has not ended: the clock is behind now, or was ahead before.

    The stored rows stay, so that the board of a phase that has really ended comes back as it was.
    """
    if ranking.finalised is not None and not ranking.ended(at):
        logger.warning("phase %s was final and has not ended: this machine's clock is or was wrong", ranking.id)
        ranking.finalised = None


def _check_quota(session: Session, ranking: Ranking, submission: Submission, team: str | None, at: datetime) -> None:
    """Counts all runs of the period, also cancelled and failed ones; not those of a time when the clock was ahead."""
    since = at - timedelta(seconds=ranking.period_s)
    ordered = select(func.count(), func.min(Evaluation.created)).select_from(Evaluation)
    ordered = ordered.where(Evaluation.ranking_id == ranking.id, Evaluation.created > since, Evaluation.created <= at)
    if team is not None:
        ordered = ordered.where(Evaluation.team_id == team)
    else:
        same_agent = select(Submission.id).where(Submission.agent_id == submission.agent_id)
        ordered = ordered.where(Evaluation.submission_id.in_(same_agent))
    count, first = session.execute(ordered).one()
    if count >= ranking.runs_per_period:
        wait_s = (first - since).total_seconds()
        raise TooManyRequestsError(
            f"{'your team' if team else 'this agent'} has ordered {count} of {ranking.runs_per_period} ranked runs "
            f"within {ranking.period_s:g} s; all count, also cancelled ones",
            retry_s=wait_s,
        )
