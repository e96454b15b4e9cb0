"""Answers of something else than a dohyo service, such as a proxy's page or another program's JSON, in one line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

LONGEST_TEXT = 200


class Answer(dict[str, Any]):
    """A document of a service. A key that it lacks is an error in words, since another program sent it."""

    def __init__(self, document: dict[str, Any], refusal: Callable[[str], Exception]) -> None:
        """Takes a document.

        Args:
            document: What was sent.
            refusal: The error for what something else sent, in words.
        """
        super().__init__(document)
        self._refusal = refusal

    def __missing__(self, key: str) -> Any:
        raise self._refusal(f"JSON without '{key}'")


def media_type(header: str | None) -> str:
    """A Content-Type without its parameters, in small letters; "" where there is none."""
    return (header or "").partition(";")[0].strip().lower()


def told(url: str, sent: str) -> str:
    """What is said of an answer that no dohyo service gives."""
    return f"no dohyo service answers at {url}: it sent {sent[:LONGEST_TEXT]}"


def redirection(location: str | None) -> str:
    """A redirection in words."""
    return f"a redirection to {location}" if location else "a redirection"
