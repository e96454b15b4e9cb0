"""Closing: stores and announces the final board of each phase when it ends, in the background."""

from __future__ import annotations

import logging
from datetime import datetime
from typing import Any, Final

from sqlalchemy import ColumnElement, select, update
from sqlalchemy.orm import Session

from dohyo.service.benchmarks.catalog import read_benchmark
from dohyo.service.boards.board import rows_of
from dohyo.service.boards.leaderboard import Unranked
from dohyo.service.boards.model import Ranking
from dohyo.service.boards.rankings import reopen
from dohyo.service.boards.standings import Standings
from dohyo.service.challenges.model import Challenge, Member
from dohyo.service.database.base import new_id, now
from dohyo.service.database.engine import Database, serialise
from dohyo.service.evaluations.model import BenchmarkVersion, Evaluation
from dohyo.service.evaluations.versions import EARLIER
from dohyo.service.state import Services
from dohyo.service.webhooks.model import Delivery, Webhook

EVERY_S: Final = 2.0

logger = logging.getLogger("dohyo.challenges")


def final_rows(database: Database, standings: Standings, ranking: Ranking, headline: str) -> list[dict[str, Any]]:
    """The rows of a ranking that has ended, which are computed, stored and announced once.

    Only where its end turned out not to have come yet, see `reopen`, they are computed again at its end. They replace
    the stored ones, and are announced again, if other runs or further ones count.

    Args:
        database: Database of the service.
        standings: Places of rankings.
        ranking: A ranking that has ended.
        headline: Score that ranks on its benchmark.
    """
    if ranking.finalised is None:
        ranking = _after_last_runs(database, ranking)
        places = standings.places(database, ranking, headline)
        with database.session() as session:
            serialise(session)
            ranking = session.get_one(Ranking, ranking.id)
            if ranking.finalised is None:
                rows = rows_of(session, ranking, places, 0, len(places))
                if not ranking.ended():
                    return rows  # it was postponed a moment ago
                if ranking.final is None or _counted(ranking.final["rows"]) != _counted(rows):
                    ranking.final = {"headline": headline, "rows": rows}
                    _announce(session, ranking, len(rows))
                ranking.finalised = now()
                logger.info("phase %s is final with %d places", ranking.id, len(rows))
    stored: list[dict[str, Any]] = (ranking.final or {})["rows"]
    return [_told(row) for row in stored]


def _told(row: dict[str, Any]) -> dict[str, Any]:
    """A row of a stored board, with what boards of before did not tell."""
    row = {"lost": 0, "lost_too_many": False, "dohyo_versions": [EARLIER], **row}
    reasons = [why for why in (Unranked.LOST_TOO_MANY, Unranked.BASELINE) if row[why]]
    return {"unranked": reasons[0] if reasons else None, **row}


def _counted(rows: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    """What a board counts: of each place the run, and what its entrant ordered and threw away."""
    return [(row["evaluation"], row.get("runs"), row.get("thrown_away")) for row in rows]


def close_ended(services: Services) -> None:
    """Makes the boards of all ended phases final, and those of phases that have not ended open again."""
    _take_back_early_ends(services.database)
    with services.database.reading() as session:
        ended = session.scalars(select(Ranking).where(Ranking.ends <= now(), Ranking.finalised.is_(None))).all()
    for ranking in ended:
        try:
            final_rows(services.database, Standings(), ranking, _headline(services.database, ranking))
        except Exception:  # tried again; the other phases must not wait for it
            logger.exception("phase %s cannot be made final", ranking.id)


def _take_back_early_ends(database: Database) -> None:
    """Opens the boards of phases that have not ended; those of their runs whose end lies ahead have ended by now.

    The clock was ahead when they ended, and they would count as too late.
    """
    with database.reading() as session:
        early = session.scalars(select(Ranking.id).where(Ranking.ends > now(), Ranking.finalised.is_not(None))).all()
        some = session.scalar(select(Evaluation.id).where(_ended_ahead(now())).limit(1)) is not None
    if early or some:
        with database.session() as session:
            for ranking in session.scalars(select(Ranking).where(Ranking.id.in_(early))):
                reopen(ranking)
            at = now()
            session.execute(update(Evaluation).where(_ended_ahead(at)).values(finished=at))


def _ended_ahead(at: datetime) -> ColumnElement[bool]:
    """Condition on `Evaluation`: of a phase that has not ended at a moment, with an end after that moment."""
    going_on = select(Ranking.id).where(Ranking.ends > at)
    return Evaluation.ranking_id.in_(going_on) & (Evaluation.finished > at)


def _after_last_runs(database: Database, ranking: Ranking) -> Ranking:
    """The ranking as it is once all runs that ended in time are stored: each holds its ranking until then."""
    with database.session() as session:
        return session.get_one(Ranking, ranking.id, with_for_update=True)


def _headline(database: Database, ranking: Ranking) -> str:
    with database.reading() as session:
        document = session.get_one(BenchmarkVersion, ranking.benchmark_sha256).document
    return str(read_benchmark(document).headline)


def _announce(session: Session, ranking: Ranking, places: int) -> None:
    """Queues a message to each webhook of the organiser and of all who take part."""
    challenge = session.get(Challenge, ranking.challenge_id) if ranking.challenge_id else None
    if challenge is None:
        return
    body: dict[str, Any] = {
        "event": "phase.final",
        "challenge": challenge.name,
        "phase": ranking.name,
        "ranking": ranking.id,
        "places": places,
    }
    owners = [challenge.owner, *session.scalars(select(Member.owner).where(Member.challenge_id == challenge.id))]
    for webhook in session.scalars(select(Webhook).where(Webhook.owner.in_(owners))):
        session.add(Delivery(id=new_id("dl"), webhook_id=webhook.id, body=body))
