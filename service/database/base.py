"""What all tables share: the declarative base, times in UTC, identifiers."""

from __future__ import annotations

import secrets
from datetime import UTC, datetime
from enum import Enum
from typing import Any

from sqlalchemy import JSON, DateTime, TypeDecorator
from sqlalchemy import Enum as EnumColumn
from sqlalchemy.engine import Dialect
from sqlalchemy.orm import DeclarativeBase


class UtcDateTime(TypeDecorator[datetime]):
    """A time in UTC; SQLite drops the zone, which is restored here."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Restores the zone."""
        return value.replace(tzinfo=UTC) if value is not None and value.tzinfo is None else value


def now() -> datetime:
    """The current time."""
    return datetime.now(UTC)


def new_id(prefix: str) -> str:
    """A random identifier, such as "ev-9f86d081884c7d65"."""
    return f"{prefix}-{secrets.token_hex(8)}"


class Base(DeclarativeBase):
    """Base of all tables."""

    type_annotation_map = {  # noqa: RUF012
        datetime: UtcDateTime,
        dict[str, Any]: JSON,
        list[int]: JSON,
        # As plain text, so that a new member needs no change of a database's types.
        Enum: EnumColumn(Enum, native_enum=False, length=20, values_callable=lambda kind: [one.value for one in kind]),
    }
