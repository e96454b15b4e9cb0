"""Who may see what of an evaluation: that it exists, its replays, its records.

Practice runs follow the service's setting `public`. A ranked run follows its ranking: an audience for the board,
another for replays, another for records. While a secret ranking has not ended, only administrators and the challenge's
organiser see more than the run's existence and progress, the run's own owner included.
"""

from __future__ import annotations

from collections.abc import Collection
from enum import StrEnum

from sqlalchemy import ColumnElement, and_, false, or_, select, true
from sqlalchemy.orm import Session

from dohyo.service.accounts.access import Caller
from dohyo.service.accounts.model import Role
from dohyo.service.boards.model import Audience, Ranking
from dohyo.service.challenges.model import Challenge, Member
from dohyo.service.database.base import now
from dohyo.service.errors import ForbiddenError, NotFoundError
from dohyo.service.evaluations.model import Evaluation


class Aspect(StrEnum):
    """Parts of an evaluation. RUN: its agent, status and progress. REPLAYS: replays, infractions, explanations.

    RECORDS: everything else: seeds, scenarios, records, trajectories, scores of single drives, failures.
    """

    RUN = "run"
    REPLAYS = "replays"
    RECORDS = "records"


_AUDIENCES = {Aspect.RUN: Ranking.board, Aspect.REPLAYS: Ranking.replays, Aspect.RECORDS: Ranking.records}


def seen_by(caller: Caller, aspect: Aspect = Aspect.RUN) -> ColumnElement[bool]:
    """Condition on `Evaluation`: the caller may see this aspect of it."""
    if caller.is_admin:
        return true()
    own = _own(caller)
    practice = and_(Evaluation.ranking_id.is_(None), or_(own, _if(caller.public)))
    if aspect is Aspect.RUN:
        return or_(own, practice, _in_rankings(_shown(caller, aspect)))
    told = or_(Ranking.secret.is_(False), Ranking.ends <= now())
    shown = or_(_organised(caller), and_(told, _shown(caller, aspect)))
    return or_(practice, _in_rankings(shown), and_(own, _in_rankings(told)))


def ranking_seen_by(caller: Caller) -> ColumnElement[bool]:
    """Condition on `Ranking`: the caller may see its board."""
    return true() if caller.is_admin else _shown(caller, Aspect.RUN)


def find_visible(session: Session, caller: Caller, evaluation_id: str) -> Evaluation:
    """An evaluation whose existence the caller may know.

    Raises:
        NotFoundError: There is none.
    """
    query = select(Evaluation).where(Evaluation.id == evaluation_id, seen_by(caller))
    evaluation = session.scalars(query).unique().one_or_none()
    if evaluation is None:
        raise NotFoundError(f"no evaluation '{evaluation_id}'")
    return evaluation


def visible_among(session: Session, caller: Caller, evaluation_ids: Collection[str], aspect: Aspect) -> set[str]:
    """Those evaluations of which the caller may see an aspect."""
    query = select(Evaluation.id).where(Evaluation.id.in_(evaluation_ids), seen_by(caller, aspect))
    return set(session.scalars(query))


def own_runs(session: Session, caller: Caller, ranking_id: str) -> frozenset[str]:
    """The caller's and its teams' runs of a ranking."""
    return frozenset(session.scalars(select(Evaluation.id).where(Evaluation.ranking_id == ranking_id, _own(caller))))


def require(session: Session, caller: Caller, evaluation: Evaluation, aspect: Aspect) -> None:
    """Refuses an aspect that is not shown to the caller.

    Raises:
        ForbiddenError: It is secret until the ranking ends, or for a smaller audience.
    """
    if visible_among(session, caller, (evaluation.id,), aspect):
        return
    ranking = evaluation.ranking
    if ranking is not None and ranking.withheld():
        until = f" until {ranking.ends:%Y-%m-%d %H:%M} UTC" if ranking.ends else ""
        raise ForbiddenError(f"the {aspect} of this ranking are secret{until}")
    raise ForbiddenError(f"the {aspect} of evaluation '{evaluation.id}' are not shown to you")


def _own(caller: Caller) -> ColumnElement[bool]:
    if caller.token_id is None:
        return false()
    teams = select(Member.team_id).where(Member.owner == caller.owner)
    return or_(Evaluation.owner == caller.owner, Evaluation.team_id.in_(teams))


def _shown(caller: Caller, aspect: Aspect) -> ColumnElement[bool]:
    """Condition on `Ranking`: its audience for an aspect includes the caller."""
    audience = _AUDIENCES[aspect]
    member = _member(caller)
    everybody = and_(audience == Audience.PUBLIC, or_(_if(caller.public), member))
    return or_(everybody, and_(audience == Audience.PARTICIPANTS, member), _organised(caller))


def _member(caller: Caller) -> ColumnElement[bool]:
    if caller.token_id is None:
        return false()
    return Ranking.challenge_id.in_(select(Member.challenge_id).where(Member.owner == caller.owner))


def _organised(caller: Caller) -> ColumnElement[bool]:
    if caller.role is not Role.ORGANISER:
        return false()
    return Ranking.challenge_id.in_(select(Challenge.id).where(Challenge.owner == caller.owner))


def _in_rankings(condition: ColumnElement[bool]) -> ColumnElement[bool]:
    return Evaluation.ranking_id.in_(select(Ranking.id).where(condition))


def _if(condition: bool) -> ColumnElement[bool]:
    return true() if condition else false()
