"""Challenges: made and found, with their phases, teams and baselines."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, Final

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session, defer

from dohyo.service.boards.model import Ranking
from dohyo.service.boards.rankings import reopen
from dohyo.service.challenges.model import Baseline, Challenge, Member, Team
from dohyo.service.database.base import new_id, now
from dohyo.service.errors import ConflictError, NotFoundError
from dohyo.service.evaluations.model import BenchmarkVersion, Evaluation
from dohyo.service.submissions.model import Agent, Submission
from dohyo.sumo_networks.errors import InvalidInputError

HELD_OUT: Final = 2**30  # seeds from here on are kept from training
SEED_LIMIT: Final = 2**31


def add_challenge(session: Session, owner: str, name: str, title: str, rules: str) -> Challenge:
    """Makes a challenge.

    Raises:
        ConflictError: The name is taken.
    """
    if session.scalar(select(Challenge.id).where(Challenge.name == name)):
        raise ConflictError(f"challenge '{name}' exists; choose another name")
    challenge = Challenge(id=new_id("ch"), name=name, owner=owner, title=title, rules=rules)
    session.add(challenge)
    session.flush()
    return challenge


def find_challenge(session: Session, name: str) -> Challenge:
    """A challenge by its name.

    Raises:
        NotFoundError: There is none.
    """
    challenge = session.scalar(select(Challenge).where(Challenge.name == name))
    if challenge is None:
        raise NotFoundError(f"no challenge '{name}'")
    return challenge


def list_challenges(session: Session, limit: int, after: str | None) -> Sequence[Challenge]:
    """Challenges by name, those past `after`."""
    query = select(Challenge).order_by(Challenge.name).limit(limit)
    return session.scalars(query.where(Challenge.name > after) if after else query).all()


def count_challenges(session: Session, owner: str) -> int:
    """Number of an organiser's challenges."""
    return session.scalar(select(func.count()).select_from(Challenge).where(Challenge.owner == owner)) or 0


def draw_seeds(count: int) -> list[int]:
    """Different seeds that nobody can guess, from those that are kept from training."""
    seeds: dict[int, None] = {}
    while len(seeds) < count:
        seeds[HELD_OUT + secrets.randbelow(SEED_LIMIT - HELD_OUT)] = None
    return list(seeds)


def add_phase(session: Session, challenge: Challenge, name: str, **conditions: Any) -> Ranking:
    """Adds a phase: a ranking of the challenge.

    Raises:
        ConflictError: The challenge has a phase of this name; case does not matter.
    """
    same = (Ranking.challenge_id == challenge.id, func.lower(Ranking.name) == name.lower())
    if (taken := session.scalar(select(Ranking.name).where(*same).limit(1))) is not None:
        raise ConflictError(f"challenge '{challenge.name}' has a phase '{taken}'; choose another name")
    phase = Ranking(id=new_id("rk"), challenge_id=challenge.id, name=name, **conditions)
    session.add(phase)
    session.flush()
    return phase


def find_phase(session: Session, ranking_id: str, benchmark: str) -> Ranking:
    """A ranking that a run on a benchmark may be ordered for.

    Raises:
        NotFoundError: There is no such ranking.
        InvalidInputError: The ranking is on another benchmark.
    """
    ranking = session.get(Ranking, ranking_id)
    if ranking is None:
        raise NotFoundError(f"no ranking '{ranking_id}'")
    there = session.get_one(BenchmarkVersion, ranking.benchmark_sha256).name
    if there != benchmark:
        raise InvalidInputError(f"benchmark: ranking '{ranking_id}' is on '{there}', got '{benchmark}'")
    return ranking


def phases_of(session: Session, challenges: Sequence[Challenge], seen: ColumnElement[bool]) -> Mapping[str, list[Any]]:
    """For each challenge its phases in the order of their closing, each with the benchmark and whether `seen` holds.

    Their final boards are not loaded, see `finals_of`.
    """
    query = (
        select(Ranking, BenchmarkVersion.name, seen)
        .join(BenchmarkVersion, BenchmarkVersion.sha256 == Ranking.benchmark_sha256)
        .where(Ranking.challenge_id.in_([one.id for one in challenges]))
        .order_by(Ranking.closes, Ranking.created, Ranking.id)
        .options(defer(Ranking.final))
    )
    phases: dict[str, list[Any]] = {one.id: [] for one in challenges}
    for ranking, benchmark, shown in session.execute(query):
        phases[ranking.challenge_id or ""].append((ranking, benchmark, bool(shown)))
    return phases


def count_phases(session: Session, challenge: Challenge) -> int:
    """Number of a challenge's phases."""
    query = select(func.count()).select_from(Ranking).where(Ranking.challenge_id == challenge.id)
    return session.scalar(query) or 0


def finals_of(session: Session, phases: Sequence[Ranking]) -> Mapping[str, dict[str, Any]]:
    """The stored final boards of those phases that have ended, by the phase's identifier."""
    ended = [phase.id for phase in phases if phase.finalised is not None and phase.ended()]
    rows = session.execute(select(Ranking.id, Ranking.final).where(Ranking.id.in_(ended))) if ended else ()
    return {phase: final for phase, final in rows if final is not None}


def count_runs(session: Session, ranking_id: str) -> int:
    """Number of runs that were ordered for a ranking."""
    query = select(func.count()).select_from(Evaluation).where(Evaluation.ranking_id == ranking_id)
    return session.scalar(query) or 0


def move_closing(ranking: Ranking, closes: datetime, ends: datetime) -> None:
    """Postpones the end of a phase that has not closed.

    Raises:
        ConflictError: It has closed, or the new time is earlier: who planned with the old one would lose.
    """
    if ranking.closes is not None and (ranking.closes <= now() or closes < ranking.closes):
        raise ConflictError(f"phase '{ranking.name}' can only be postponed, and only before it closes")
    ranking.closes, ranking.ends = closes, ends
    reopen(ranking)


def remove_phase(session: Session, phase: Ranking) -> None:
    """Deletes a phase without runs.

    Raises:
        ConflictError: Runs were ordered for it, which stay on its board.
    """
    if count_runs(session, phase.id):
        raise ConflictError(f"runs were ordered for phase '{phase.name}'; only a phase without runs can be deleted")
    session.delete(phase)
    session.flush()


def teams_of(session: Session, challenge: Challenge) -> list[tuple[Team, list[str]]]:
    """Teams of a challenge by name, each with its members."""
    query = (
        select(Team, Member.owner)
        .join(Member, Member.team_id == Team.id)
        .where(Team.challenge_id == challenge.id)
        .order_by(Team.name, Member.joined, Member.owner)
    )
    teams: dict[str, tuple[Team, list[str]]] = {}
    for team, owner in session.execute(query):
        teams.setdefault(team.id, (team, []))[1].append(owner)
    return list(teams.values())


def team_of_member(session: Session, challenges: Sequence[Challenge], owner: str) -> Mapping[str, str]:
    """Name of an owner's team in each challenge that it is in."""
    query = select(Member.challenge_id, Team.name).join(Team, Team.id == Member.team_id)
    query = query.where(Member.owner == owner, Member.challenge_id.in_([one.id for one in challenges]))
    return {row[0]: row[1] for row in session.execute(query)}


def count_teams(session: Session, challenges: Sequence[Challenge]) -> Mapping[str, int]:
    """Number of teams of each challenge."""
    query = select(Team.challenge_id, func.count()).where(Team.challenge_id.in_([one.id for one in challenges]))
    return {row[0]: row[1] for row in session.execute(query.group_by(Team.challenge_id))}


def add_baseline(session: Session, challenge: Challenge, submission: Submission) -> None:
    """Marks a submission as a baseline; has no effect on one that is."""
    if session.get(Baseline, (challenge.id, submission.id)) is None:
        session.add(Baseline(challenge_id=challenge.id, submission_id=submission.id))
        session.flush()


def remove_baseline(session: Session, challenge: Challenge, submission_id: str) -> None:
    """Removes the mark of a baseline.

    Raises:
        NotFoundError: It is none.
    """
    baseline = session.get(Baseline, (challenge.id, submission_id))
    if baseline is None:
        raise NotFoundError(f"submission '{submission_id}' is no baseline of challenge '{challenge.name}'")
    session.delete(baseline)


def baselines_of(session: Session, challenges: Sequence[Challenge]) -> Mapping[str, Sequence[tuple[Submission, str]]]:
    """For each challenge its baselines with the names of their agents."""
    query = (
        select(Baseline.challenge_id, Submission, Agent.name)
        .join(Submission, Submission.id == Baseline.submission_id)
        .join(Agent, Agent.id == Submission.agent_id)
        .where(Baseline.challenge_id.in_([one.id for one in challenges]))
        .order_by(Agent.name, Submission.version)
    )
    found: dict[str, list[tuple[Submission, str]]] = {one.id: [] for one in challenges}
    for challenge, submission, agent in session.execute(query).unique():
        found[challenge].append((submission, agent))
    return found
