"""Shared parts of the reading routes: identifiers, and answers that never change."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Path, Request
from pydantic import BaseModel

from dohyo.service.state import Services
from dohyo.service.web.spelling import ID

YEAR_S = 31_536_000

Identified = Annotated[str, Path(min_length=1, max_length=40, pattern=ID, examples=["ep-9f86d081884c7d65"])]


class Cached:
    """OpenAPI entries of answers that caches may keep."""

    @staticmethod
    def json(model: type[BaseModel] | None = None) -> dict[int | str, dict[str, Any]]:
        """JSON answer from a model or any plain JSON."""
        entry: dict[str, Any] = {"description": "Never changes."}
        entry |= {"model": model} if model else {"content": {"application/json": {"schema": {"type": "object"}}}}
        return {200: entry, 304: {"description": "What the caller has is still right."}}

    @staticmethod
    def file(media_type: str) -> dict[int | str, dict[str, Any]]:
        """Answer with the content of a file."""
        content = {media_type: {"schema": {"type": "string", "format": "binary"}}}
        return {
            200: {"description": "Never changes.", "content": content},
            206: {"description": "The range asked for.", "content": content},
            304: {"description": "What the caller has is still right."},
            416: {"description": "No such range."},
        }


def immutable(tag: str, services: Services) -> dict[str, str]:
    """Cache headers of an answer that never changes; shared caches may keep only public answers."""
    scope = "public" if services.settings.public else "private"
    return {"etag": f'"{tag}"', "cache-control": f"{scope}, max-age={YEAR_S}, immutable"}


def already_has(request: Request, headers: dict[str, str]) -> bool:
    """Whether the caller's If-None-Match matches the answer."""
    given = request.headers.get("if-none-match", "")
    tags = {tag.strip().removeprefix("W/") for tag in given.split(",")}
    return headers["etag"] in tags or "*" in tags
