"""What all answers share."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Generic, TypeVar

from pydantic import BaseModel, ConfigDict, Field

T = TypeVar("T")


Version = Annotated[str, Field(description="Content hash.", examples=["4f0c" * 16])]


Moment = Annotated[datetime, Field(examples=["2026-01-31T12:00:00Z"])]


class View(BaseModel):
    """Base of all answers."""

    model_config = ConfigDict(frozen=True)


class Problem(View):
    """An error (RFC 9457), as `application/problem+json`."""

    type: str = "about:blank"
    title: Annotated[str, Field(examples=["Not Found"])]
    status: Annotated[int, Field(examples=[404])]
    detail: Annotated[str, Field(examples=["no benchmark named 'quickstat'; did you mean 'quickstart'?"])]
    errors: list[dict[str, str]] | None = None


class Page(View, Generic[T]):
    """A page of items with the cursor of the next page."""

    items: list[T]
    next: Annotated[str | None, Field(description="To be given as `after`; null at the end.")] = None
