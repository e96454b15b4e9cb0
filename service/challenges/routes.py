"""Challenges: made, shown and changed, with their phases, baselines and teams."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import timedelta
from typing import Annotated, Any

from fastapi import APIRouter, Path
from sqlalchemy.orm import Session

from dohyo.service.accounts.access import Caller, Organiser, Reader
from dohyo.service.benchmarks.catalog import find_benchmark
from dohyo.service.boards.model import Ranking
from dohyo.service.boards.ranking_views import RankingView, view_ranking
from dohyo.service.challenges import queries as challenges
from dohyo.service.challenges.model import Challenge
from dohyo.service.challenges.orders import BaselineOrder, ChallengeChange, ChallengeOrder, PhaseChange, PhaseOrder
from dohyo.service.challenges.suitability import check_phase
from dohyo.service.challenges.views import (
    AnnouncementView,
    BaselineView,
    ChallengeView,
    TeamView,
    view_baseline,
    view_challenge,
    view_team,
)
from dohyo.service.database.base import now
from dohyo.service.database.engine import serialise
from dohyo.service.errors import ForbiddenError, NotFoundError, TooManyRequestsError
from dohyo.service.evaluations.access import ranking_seen_by
from dohyo.service.evaluations.queries import save_benchmark
from dohyo.service.state import ServicesOf
from dohyo.service.submissions.queries import find_agent, find_submission
from dohyo.service.web.bodies.strict_route import StrictRoute
from dohyo.service.web.documents import After, Identifier, Limit, problems
from dohyo.service.web.views import Page
from dohyo.sumo_networks.errors import InvalidInputError

router = APIRouter(prefix="/v1/challenges", tags=["challenges"], route_class=StrictRoute)

PER_OWNER = 50
PHASES = 50

_Phase = tuple[Ranking, RankingView]
Name = Annotated[str, Path(min_length=1, max_length=100, description="Name of a challenge.", examples=["autumn-2026"])]


@router.post("", status_code=201, responses=problems(403, 409, 413, 507))
def create_challenge(order: ChallengeOrder, caller: Organiser, services: ServicesOf) -> ChallengeView:
    """Makes a challenge without phases; the caller organises it. Needs a token of role organiser."""
    with services.database.session() as session:
        serialise(session)
        if challenges.count_challenges(session, caller.owner) >= PER_OWNER:
            raise TooManyRequestsError(f"at most {PER_OWNER} challenges of one organiser", retry_s=3600)
        challenge = challenges.add_challenge(session, caller.owner, order.name, order.title, order.rules)
        return _views(session, caller, [challenge])[0]


@router.get("", responses=problems())
def list_challenges(
    caller: Reader, services: ServicesOf, limit: Limit = 100, after: After = None
) -> Page[ChallengeView]:
    """Lists challenges by name."""
    with services.database.reading() as session:
        rows = challenges.list_challenges(session, limit + 1, after)
        items = _views(session, caller, rows[:limit])
    return Page(items=items, next=items[-1].name if len(rows) > limit else None)


@router.get("/{name}", responses=problems(404))
def get_challenge(name: Name, caller: Reader, services: ServicesOf) -> ChallengeView:
    """One challenge: rules, phases, baselines, announced final boards, and the caller's team."""
    with services.database.reading() as session:
        return _views(session, caller, [challenges.find_challenge(session, name)])[0]


@router.patch("/{name}", responses=problems(403, 404, 413, 507))
def change_challenge(name: Name, change: ChallengeChange, caller: Organiser, services: ServicesOf) -> ChallengeView:
    """Changes the title or the rules."""
    with services.database.session() as session:
        challenge = organised(session, caller, name)
        challenge.title = change.title if change.title is not None else challenge.title
        challenge.rules = change.rules if change.rules is not None else challenge.rules
        session.flush()
        return _views(session, caller, [challenge])[0]


@router.post("/{name}/phases", status_code=201, responses=problems(403, 404, 409, 413, 507))
def create_phase(name: Name, order: PhaseOrder, caller: Organiser, services: ServicesOf) -> RankingView:
    """Adds a phase: a ranking with its own seeds, quota, times and audiences, all fixed from now on."""
    if order.closes <= now():
        raise InvalidInputError("closes: expected a time in the future")
    benchmark = find_benchmark(order.benchmark)
    seeds = challenges.draw_seeds(order.draw_seeds) if order.draw_seeds else order.seeds or benchmark.seeds
    seeds = list(dict.fromkeys(seeds))
    check_phase(order, benchmark, seeds)
    benchmark.scenarios(seeds[:1])  # a benchmark that cannot be driven is refused now, and not at the first run
    kept = "name", "secret", "runs_per_period", "period_s", "counts", "opens", "closes", "ends", "slow_policy", "track"
    audiences = "verified_only", "board", "replays", "records"
    with services.database.session() as session:
        serialise(session)
        challenge = organised(session, caller, name)
        if challenges.count_phases(session, challenge) >= PHASES:
            raise TooManyRequestsError(f"at most {PHASES} phases of one challenge", retry_s=3600)
        phase = challenges.add_phase(
            session,
            challenge,
            benchmark_sha256=save_benchmark(session, benchmark).sha256,
            seeds=seeds,
            act_deadline_s=order.act_deadline_s or services.settings.act_deadline_s,
            **{field: getattr(order, field) for field in (*kept, *audiences)},
        )
        return view_ranking(phase, benchmark.name, challenge.name, at=now(), told=True, board_visible=True)


@router.patch("/{name}/phases/{identifier}", responses=problems(403, 404, 409, 413, 507))
def postpone_phase(
    name: Name, identifier: Identifier, change: PhaseChange, caller: Organiser, services: ServicesOf
) -> RankingView:
    """Postpones the closing of a phase that has not closed; its grace stays as long as it was."""
    with services.database.session() as session:
        serialise(session)
        challenge = organised(session, caller, name)
        phase = _phase_of(session, challenge, identifier)
        grace = phase.ends - phase.closes if phase.ends and phase.closes else timedelta()
        challenges.move_closing(phase, change.closes, change.closes + grace)
        session.flush()
        return next(view for _, view in _phases(session, caller, [challenge])[challenge.id] if view.id == identifier)


@router.delete("/{name}/phases/{identifier}", status_code=204, responses=problems(403, 404, 409))
def delete_phase(name: Name, identifier: Identifier, caller: Organiser, services: ServicesOf) -> None:
    """Deletes a phase for which nobody has ordered a run."""
    with services.database.session() as session:
        serialise(session)
        challenges.remove_phase(session, _phase_of(session, organised(session, caller, name), identifier))


@router.post("/{name}/baselines", status_code=201, responses=problems(403, 404, 413, 507))
def create_baseline(name: Name, order: BaselineOrder, caller: Organiser, services: ServicesOf) -> BaselineView:
    """Marks a submission of the organiser: its ranked runs stand on the boards, without a rank."""
    with services.database.session() as session:
        challenge = organised(session, caller, name)
        agent = find_agent(session, order.agent)
        if agent is None or agent.owner != challenge.owner:
            raise NotFoundError(f"the organiser has no agent '{order.agent}'")
        submission = find_submission(session, agent, order.version)
        if submission is None:
            raise NotFoundError(f"agent '{order.agent}' has no such version")
        challenges.add_baseline(session, challenge, submission)
        return view_baseline(submission, agent.name)


@router.delete("/{name}/baselines/{identifier}", status_code=204, responses=problems(403, 404))
def delete_baseline(name: Name, identifier: Identifier, caller: Organiser, services: ServicesOf) -> None:
    """Removes the mark of a baseline; runs that it made stay where they are."""
    with services.database.session() as session:
        challenges.remove_baseline(session, organised(session, caller, name), identifier)


@router.get("/{name}/teams", responses=problems(403, 404))
def list_teams(name: Name, caller: Reader, services: ServicesOf) -> list[TeamView]:
    """Lists the teams with their members; for participants and the organiser."""
    with services.database.reading() as session:
        challenge = challenges.find_challenge(session, name)
        member = caller.token_id and challenges.team_of_member(session, [challenge], caller.owner)
        if not member and not caller.organises(challenge.owner):
            raise ForbiddenError(f"the teams of challenge '{name}' are shown to its participants alone")
        return [view_team(*one) for one in challenges.teams_of(session, challenge)]


def organised(session: Session, caller: Caller, name: str) -> Challenge:
    """A challenge that the caller organises.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: Another owner organises it.
    """
    challenge = challenges.find_challenge(session, name)
    if not caller.organises(challenge.owner):
        raise ForbiddenError(f"challenge '{name}' is organised by another owner")
    return challenge


def _phase_of(session: Session, challenge: Challenge, identifier: str) -> Ranking:
    phase = session.get(Ranking, identifier)
    if phase is None or phase.challenge_id != challenge.id:
        raise NotFoundError(f"challenge '{challenge.name}' has no phase '{identifier}'")
    return phase


def _views(session: Session, caller: Caller, rows: Sequence[Challenge]) -> list[ChallengeView]:
    phases, counts = _phases(session, caller, rows), challenges.count_teams(session, rows)
    mine = challenges.team_of_member(session, rows, caller.owner) if caller.token_id else {}
    baselines = challenges.baselines_of(session, rows)
    finals = challenges.finals_of(session, [ranking for one in rows for ranking, _ in phases[one.id]])
    return [
        view_challenge(
            one,
            [view for _, view in phases[one.id]],
            baselines[one.id],
            _announcements(phases[one.id], finals),
            teams=counts.get(one.id, 0),
            my_team=mine.get(one.id),
            may_organise=caller.organises(one.owner),
        )
        for one in rows
    ]


def _phases(session: Session, caller: Caller, rows: Sequence[Challenge]) -> dict[str, list[_Phase]]:
    at = now()
    found = challenges.phases_of(session, rows, ranking_seen_by(caller))
    return {
        one.id: [
            (
                ranking,
                view_ranking(
                    ranking, benchmark, one.name, at=at, told=caller.organises(one.owner), board_visible=board_visible
                ),
            )
            for ranking, benchmark, board_visible in found[one.id]
        ]
        for one in rows
    }


def _announcements(phases: Sequence[_Phase], finals: Mapping[str, dict[str, Any]]) -> list[AnnouncementView]:
    """Final boards that are stored, the newest first."""
    found = []
    for ranking, phase in phases:
        if ranking.finalised is not None and (final := finals.get(ranking.id)) is not None:
            rows: list[dict[str, Any]] = final["rows"]
            found.append(
                AnnouncementView(
                    phase=phase.name,
                    ranking=phase.id,
                    finalised=ranking.finalised,
                    places=len(rows),
                    winners=[_winner(row, final["headline"]) for row in rows if row["rank"] == 1]
                    if phase.board_visible
                    else None,
                )
            )
    return sorted(found, key=lambda one: one.finalised, reverse=True)


def _winner(row: dict[str, Any], headline: str) -> dict[str, Any]:
    score = row["scores"][headline]["mean"]
    return {"team": row["team"], "agent": row["agent"], "version": row["version"], "score": score}
