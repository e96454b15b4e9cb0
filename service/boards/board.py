"""Board: the rows of a ranking as plain JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from typing import Any, Final

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session

from dohyo.evaluation.statistics import paired
from dohyo.service.boards.leaderboard import Contender, Place
from dohyo.service.boards.model import Ranking, Result
from dohyo.service.challenges.model import Team
from dohyo.service.evaluations.model import Attempt, Episode, Evaluation
from dohyo.service.submissions.model import Agent, AgentKind, Submission

_MOST_COMPARISONS: Final = 20  # of a contender, with the runs that stood above it on some board


def rows_of(session: Session, ranking: Ranking, places: Sequence[Place], start: int, end: int) -> list[dict[str, Any]]:
    """The rows from `start` to `end` of a board, in plain JSON."""
    page = places[start:end]
    facts = _facts(session, [place.contender.evaluation for place in page])
    entrants = [place.contender.entrant for place in page]
    runs, thrown_away = _runs(session, ranking, entrants), _thrown_away(session, ranking, entrants)
    return [
        {
            "rank": place.rank,
            "baseline": place.contender.baseline,
            **facts[place.contender.evaluation],
            "runs": runs.get(place.contender.entrant, 0),
            "thrown_away": thrown_away.get(place.contender.entrant, 0),
            "lost_too_many": place.contender.lost_too_many,
            "unranked": place.unranked,
            "above": compare_places(place.contender, places[index - 1].contender) if index else None,
        }
        for index, place in enumerate(page, start)
        if place.contender.evaluation in facts  # it was deleted a moment ago
    ]


def _facts(session: Session, evaluation_ids: Sequence[str]) -> dict[str, dict[str, Any]]:
    query = (
        select(Result.facts, Evaluation.id, Evaluation.seeds, Evaluation.finished)
        .add_columns(Submission.id, Submission.version, Submission.kind, Submission.track)
        .add_columns(Agent.name, Agent.owner, Team.name, Evaluation.dohyo_versions)
        .join(Evaluation, Evaluation.id == Result.evaluation_id)
        .join(Submission, Submission.id == Evaluation.submission_id)
        .join(Agent, Agent.id == Submission.agent_id)
        .outerjoin(Team, Team.id == Evaluation.team_id)
        .where(Result.evaluation_id.in_(evaluation_ids))
    )
    found: dict[str, dict[str, Any]] = {}
    for facts, one, seeds, finished, *submitted, agent, owner, team, dohyo_versions in session.execute(query):
        submission, version, kind, track = submitted
        found[one] = {
            "agent": agent,
            "version": version,
            "submission": submission,
            "evaluation": one,
            "owner": owner,
            "team": team,
            "kind": kind.value,
            "verified": kind is not AgentKind.REMOTE,
            "track": track,
            "dohyo_versions": dohyo_versions,
            "seeds": len(seeds),
            "episodes": facts["episodes"],
            "drives": facts["drives"],
            "lost": facts.get("lost", 0),  # results of before had none
            "finished": finished.isoformat() if finished else None,
            "scores": facts["scores"],
            "per_km": facts["per_km"],
        }
    return found


def _runs(session: Session, ranking: Ranking, entrants: Sequence[str]) -> Mapping[str, int]:
    """Number of ordered runs of each entrant, also of those that failed or were cancelled."""
    entrant, of_entrants = _entrant(ranking, entrants)
    query = (
        select(entrant, func.count())
        .select_from(Evaluation)
        .join(Submission, Submission.id == Evaluation.submission_id)
        .where(Evaluation.ranking_id == ranking.id, of_entrants)
    )
    return {row[0]: row[1] for row in session.execute(query.group_by(entrant))}


def _thrown_away(session: Session, ranking: Ranking, entrants: Sequence[str]) -> Mapping[str, int]:
    """Number of attempts that each entrant left or cancelled, over all its runs."""
    entrant, of_entrants = _entrant(ranking, entrants)
    query = (
        select(entrant, func.count())
        .select_from(Attempt)
        .join(Episode, Episode.id == Attempt.episode_id)
        .join(Evaluation, Evaluation.id == Episode.evaluation_id)
        .join(Submission, Submission.id == Evaluation.submission_id)
        .where(Attempt.charged, Evaluation.ranking_id == ranking.id, of_entrants)
    )
    return {row[0]: row[1] for row in session.execute(query.group_by(entrant))}


def _entrant(ranking: Ranking, entrants: Sequence[str]) -> tuple[ColumnElement[Any], ColumnElement[bool]]:
    """Entrant of an `Evaluation` with its `Submission`; and whether it is one of these, in columns with an index."""
    if ranking.challenge_id is None:
        return Submission.agent_id.expression, Submission.agent_id.in_(entrants)
    alone = Evaluation.team_id.is_(None) & Evaluation.submission_id.in_(entrants)
    return func.coalesce(Evaluation.team_id, Evaluation.submission_id), Evaluation.team_id.in_(entrants) | alone


def compare_places(contender: Contender, above: Contender) -> dict[str, Any] | None:
    """Paired comparison of a place with the one above it, as plain JSON; None without a drive that counts in both.

    It is kept in the contender, so that it goes with the ranking in memory.
    """
    kept = contender.comparisons
    with suppress(KeyError):
        return kept[above.evaluation]
    common = contender.common(above)
    comparison = None
    if common.any():
        comparison = asdict(paired(contender.values[common].tolist(), above.values[common].tolist()))
    if len(kept) >= _MOST_COMPARISONS:
        kept.clear()
    kept[above.evaluation] = comparison
    return comparison
