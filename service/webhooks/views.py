"""Answers of the webhook routes."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

from pydantic import Field

from dohyo.service.web.views import Moment, View
from dohyo.service.webhooks.model import Webhook
from dohyo.service.webhooks.queries import Standing


class WebhookView(View):
    """A URL for an owner's messages at the end of evaluations."""

    id: str
    url: Annotated[str, Field(examples=["https://example.org/hook"])]
    created: Moment
    waiting: Annotated[int, Field(description="Messages that will be sent, or sent again.")]
    given_up: Annotated[
        int, Field(description="Messages of the last two weeks that will not be sent again: after three days, or 410.")
    ]
    delivered: Annotated[Moment | None, Field(description="When a message was last accepted; null: none is kept.")]
    failed: Annotated[
        Moment | None, Field(description="Last failed attempt at a message that is not accepted yet; null: none.")
    ]
    failure: Annotated[str | None, Field(description="Why it failed.", examples=["it answered 503"])]


class NewWebhook(WebhookView):
    """A new webhook; its secret cannot be read again."""

    secret: Annotated[str, Field(description="Key of the signature in `Dohyo-Signature`.")]


def view_webhook(webhook: Webhook, standing: Standing) -> WebhookView:
    """A webhook, without its secret."""
    return WebhookView(id=webhook.id, url=webhook.url, created=webhook.created, **asdict(standing))
