"""What the reading routes have in common: identifiers, and answers that never change."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Path, Request
from pydantic import BaseModel

from dohyo.service.state import Services

ID = r"^[A-Za-z0-9_-]+$"
YEAR_S = 31_536_000

Identified = Annotated[str, Path(min_length=1, max_length=40, pattern=ID, examples=["ep-9f86d081884c7d65"])]


class Cached:
    """OpenAPI entries of answers that a cache may keep."""

    @staticmethod
    def json(model: type[BaseModel] | None = None) -> dict[int | str, dict[str, Any]]:
        """JSON of a model, or any."""
        entry: dict[str, Any] = {"description": "Never changes."}
        entry |= {"model": model} if model else {"content": {"application/json": {"schema": {"type": "object"}}}}
        return {200: entry, 304: {"description": "What the caller has is still right."}}

    @staticmethod
    def file(media_type: str) -> dict[int | str, dict[str, Any]]:
        """A file."""
        content = {media_type: {"schema": {"type": "string", "format": "binary"}}}
        return {
            200: {"description": "Never changes.", "content": content},
            206: {"description": "The range asked for.", "content": content},
            304: {"description": "What the caller has is still right."},
            416: {"description": "No such range."},
        }


def immutable(tag: str, services: Services) -> dict[str, str]:
    """Headers of what will never change; shared caches may keep it only where everybody may see it."""
    scope = "public" if services.settings.public else "private"
    return {"etag": f'"{tag}"', "cache-control": f"{scope}, max-age={YEAR_S}, immutable"}


def already_has(request: Request, headers: dict[str, str]) -> bool:
    """Whether the caller's If-None-Match names what it would get."""
    given = request.headers.get("if-none-match", "")
    tags = {tag.strip().removeprefix("W/") for tag in given.split(",")}
    return headers["etag"] in tags or "*" in tags
