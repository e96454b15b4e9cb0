"""Answers of the webhook routes."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from dohyo.service.web.views import Moment, View
from dohyo.service.webhooks.model import Webhook


class WebhookView(View):
    """A URL for an owner's messages at the end of evaluations."""

    id: str
    url: Annotated[str, Field(examples=["https://example.org/hook"])]
    created: Moment


class NewWebhook(WebhookView):
    """A new webhook; its secret cannot be read again."""

    secret: Annotated[str, Field(description="Key of the signature in `Dohyo-Signature`.")]


def view_webhook(webhook: Webhook) -> WebhookView:
    """A webhook, without its secret."""
    return WebhookView(id=webhook.id, url=webhook.url, created=webhook.created)
