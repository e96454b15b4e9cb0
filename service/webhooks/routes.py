"""Webhooks: messages to an owner's URL when an evaluation ends."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field

from dohyo.service.accounts.access import Submitter
from dohyo.service.database.engine import serialise
from dohyo.service.errors import NotFoundError, TooManyRequestsError
from dohyo.service.state import ServicesOf
from dohyo.service.web.bodies.strict_route import StrictRoute
from dohyo.service.web.documents import After, Identifier, Limit, problems
from dohyo.service.web.views import Page
from dohyo.service.webhooks import queries
from dohyo.service.webhooks.delivery import check_url
from dohyo.service.webhooks.model import Webhook
from dohyo.service.webhooks.views import NewWebhook, WebhookView, view_webhook

router = APIRouter(prefix="/v1/webhooks", tags=["webhooks"], responses=problems(403), route_class=StrictRoute)

PER_OWNER = 10


class WebhookOrder(BaseModel):
    """The URL of a new webhook."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"url": "https://example.org/hook"}]})

    url: Annotated[str, Field(min_length=8, max_length=2000)]


@router.post("", status_code=201, responses=problems(403, 413, 507))
def create_webhook(order: WebhookOrder, caller: Submitter, services: ServicesOf) -> NewWebhook:
    """Registers a URL; the answer holds the key of its signatures, which cannot be read again.

    Each message is a POST with `Dohyo-Signature: t=TIMESTAMP,v1=HEX`, the HMAC-SHA256 of "TIMESTAMP.BODY" under that
    key. It is repeated, at last once an hour, until the answer is 2xx. After three days it is given up, and at once
    where the answer is 410. Redirects are not followed.
    """
    check_url(order.url, private_allowed=services.settings.webhook_private_addresses)
    with services.database.session() as session:
        serialise(session)
        if queries.count_webhooks(session, caller.owner) >= PER_OWNER:
            raise TooManyRequestsError(f"at most {PER_OWNER} webhooks; delete one", retry_s=3600)
        webhook = queries.add_webhook(session, caller.owner, order.url)
    return NewWebhook(**view_webhook(webhook, queries.Standing()).model_dump(), secret=webhook.secret)


@router.get("")
def list_webhooks(
    caller: Submitter, services: ServicesOf, limit: Limit = 100, after: After = None
) -> Page[WebhookView]:
    """Lists your webhooks, and whether their messages are accepted."""
    with services.database.reading() as session:
        rows = queries.list_webhooks(session, caller.owner, limit + 1, after)
        found = queries.standings(session, rows[:limit])
        items = [view_webhook(webhook, found.get(webhook.id, queries.Standing())) for webhook in rows[:limit]]
    return Page(items=items, next=items[-1].id if len(rows) > limit else None)


@router.delete("/{identifier}", status_code=204, responses=problems(403, 404))
def delete_webhook(identifier: Identifier, caller: Submitter, services: ServicesOf) -> None:
    """Deletes a webhook and its unsent messages."""
    with services.database.session() as session:
        webhook = session.get(Webhook, identifier)
        if webhook is None or not caller.owns(webhook.owner):
            raise NotFoundError(f"no webhook '{identifier}'")
        session.delete(webhook)
