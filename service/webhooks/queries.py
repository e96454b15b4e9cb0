"""Webhooks: their URLs and the messages that are not yet delivered."""

from __future__ import annotations

import secrets
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import delete, func, or_, select
from sqlalchemy.orm import Session

from dohyo.service.database.base import new_id, now
from dohyo.service.evaluations.model import Evaluation, EvaluationStatus
from dohyo.service.evaluations.queries import mark_announced, names_of
from dohyo.service.webhooks.model import Delivery, Webhook

ATTEMPTS = 81
"""Attempts at a message until it is given up, after three days of waiting in all."""
FIRST_WAIT = timedelta(seconds=10)
LONGEST_WAIT = timedelta(hours=1)
KEPT = timedelta(days=14)
"""Time for which a message is kept that was delivered or given up."""
FINISHED = tuple(status for status in EvaluationStatus if status.finished)


@dataclass(frozen=True, slots=True)
class Standing:
    """How the messages of a webhook fare that are still kept.

    Attributes:
        waiting: Number of messages that will be sent, or sent again.
        given_up: Number of messages that will not be sent again.
        delivered: Time of the last message that was accepted.
        failed: Time of the last failed attempt at a message that is not accepted yet.
        failure: Reason of that failure.
    """

    waiting: int = 0
    given_up: int = 0
    delivered: datetime | None = None
    failed: datetime | None = None
    failure: str | None = None


def add_webhook(session: Session, owner: str, url: str) -> Webhook:
    """Registers a webhook with a new secret."""
    webhook = Webhook(id=new_id("wh"), owner=owner, url=url, secret=secrets.token_urlsafe(32))
    session.add(webhook)
    session.flush()
    return webhook


def count_webhooks(session: Session, owner: str) -> int:
    """Number of an owner's webhooks."""
    return session.scalar(select(func.count()).select_from(Webhook).where(Webhook.owner == owner)) or 0


def list_webhooks(
    session: Session, owner: str | None, limit: int | None = None, after: str | None = None
) -> Sequence[Webhook]:
    """Webhooks of an owner (None: of all) by identifier, those past `after`."""
    query = select(Webhook).order_by(Webhook.id).limit(limit)
    if owner is not None:
        query = query.where(Webhook.owner == owner)
    return session.scalars(query.where(Webhook.id > after) if after else query).all()


def standings(session: Session, webhooks: Sequence[Webhook]) -> Mapping[str, Standing]:
    """How the messages of some webhooks fare, by the webhook's identifier; those without messages are left out."""
    mine = Delivery.webhook_id.in_([webhook.id for webhook in webhooks])
    accepted = select(Delivery.webhook_id, func.max(Delivery.delivered)).where(mine).group_by(Delivery.webhook_id)
    found = {webhook: Standing(delivered=delivered) for webhook, delivered in session.execute(accepted)}
    open_ones = select(Delivery.webhook_id, Delivery.attempts, Delivery.due, Delivery.failure)
    for webhook, attempts, due, failure in session.execute(open_ones.where(mine, Delivery.delivered.is_(None))):
        so_far, given_up = found[webhook], attempts >= ATTEMPTS
        found[webhook] = replace(so_far, waiting=so_far.waiting + (not given_up), given_up=so_far.given_up + given_up)
        failed = due - wait_after(attempts) if attempts else None
        if failed is not None and (so_far.failed is None or failed > so_far.failed):
            found[webhook] = replace(found[webhook], failed=failed, failure=failure)
    return found


def wait_after(attempts: int) -> timedelta:
    """Time until a message is sent again, of which so many attempts have failed; it doubles until it is the longest."""
    return min(FIRST_WAIT * (1 << min(attempts - 1, 20)), LONGEST_WAIT)


def unannounced(session: Session) -> Sequence[Evaluation]:
    """Ended evaluations that have no deliveries yet."""
    news = or_(Evaluation.announced.is_(None), Evaluation.announced < Evaluation.finished)
    return session.scalars(select(Evaluation).where(Evaluation.status.in_(FINISHED), news)).unique().all()


def announce(session: Session) -> int:
    """Stores one delivery per ended evaluation and webhook of its owner, once; returns their number."""
    ended = unannounced(session)
    names = names_of(session, ended)
    deliveries = 0
    for evaluation in ended:
        body = _body(evaluation, *names[evaluation.id])
        for webhook in session.scalars(select(Webhook).where(Webhook.owner == evaluation.owner)):
            session.add(Delivery(id=new_id("dl"), webhook_id=webhook.id, body=body))
            deliveries += 1
        mark_announced(session, evaluation)
    return deliveries


def due_deliveries(
    session: Session, limit: int, at: datetime | None = None, but: Collection[str] = ()
) -> Sequence[tuple[Delivery, Webhook]]:
    """The first delivery of each webhook that is due now, with the webhook.

    One that would wait longer than the longest wait is due, too: it was stored while the clock was ahead.

    Args:
        session: To read from.
        limit: Most deliveries.
        at: Time of "now".
        but: Identifiers of webhooks to leave out.
    """
    at = at or now()
    due = or_(Delivery.due <= at, Delivery.due > at + LONGEST_WAIT)
    turn = func.row_number().over(partition_by=Delivery.webhook_id, order_by=(Delivery.due, Delivery.id))
    waiting = (
        select(Delivery.id, turn.label("turn"))
        .where(Delivery.delivered.is_(None), Delivery.attempts < ATTEMPTS, due)
        .where(Delivery.webhook_id.not_in(but))
        .subquery()
    )
    query = (
        select(Delivery, Webhook)
        .join(waiting, waiting.c.id == Delivery.id)
        .join(Webhook, Webhook.id == Delivery.webhook_id)
        .where(waiting.c.turn == 1)
        .order_by(Delivery.due)
        .limit(limit)
    )
    return [(delivery, webhook) for delivery, webhook in session.execute(query)]


def settle(session: Session, delivery_id: str, failure: str | None, *, final: bool = False) -> None:
    """Stores the result of a delivery; after a failure it is due again, see `wait_after`.

    Old messages of its webhook are deleted.

    Args:
        session: To write in.
        delivery_id: Identifier of the delivery.
        failure: Reason of a failure; None after a success.
        final: Whether to give up after a failure.
    """
    delivery = session.get(Delivery, delivery_id)
    if delivery is None:
        return  # the webhook was deleted in the meantime
    delivery.attempts = ATTEMPTS if final else delivery.attempts + 1
    delivery.failure = failure[:500] if failure else None
    if failure is None:
        delivery.delivered = now()
    else:
        delivery.due = now() + wait_after(delivery.attempts)
    ended = or_(Delivery.delivered.is_not(None), Delivery.attempts >= ATTEMPTS)
    old = delete(Delivery).where(Delivery.webhook_id == delivery.webhook_id, Delivery.due < now() - KEPT, ended)
    session.execute(old.execution_options(synchronize_session=False))


def _body(evaluation: Evaluation, agent: str, benchmark: str) -> dict[str, Any]:
    finished = evaluation.finished
    return {
        "event": "evaluation.finished",
        "evaluation": evaluation.id,
        "agent": agent,
        "version": evaluation.submission.version,
        "benchmark": benchmark,
        "benchmark_version": evaluation.benchmark_sha256,
        "status": evaluation.status.value,
        "failure": None if evaluation.ranking is not None and evaluation.ranking.withheld() else evaluation.failure,
        "finished": finished.isoformat() if finished else None,
    }
