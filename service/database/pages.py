"""Pages of a list, the newest row first: each begins behind the last row of the one before."""

from __future__ import annotations

from typing import Any, TypeVar

from sqlalchemy import Select, false, tuple_
from sqlalchemy.orm import Session

T = TypeVar("T")


def newest_first(
    session: Session, query: Select[T], table: type[Any], limit: int | None, after: str | None
) -> Select[T]:
    """The rows of a query, the newest first, those older than `after`.

    Args:
        session: To read in.
        query: Of rows of the table.
        table: Has the columns `id` and `created`.
        limit: Largest number of rows.
        after: Identifier of a row; an unknown one gives none.
    """
    query = query.order_by(table.created.desc(), table.id.desc()).limit(limit)
    if after is None:
        return query
    last = session.get(table, after)
    if last is None:
        return query.where(false())
    return query.where(tuple_(table.created, table.id) < tuple_(last.created, last.id))
