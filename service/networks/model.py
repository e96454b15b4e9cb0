"""Uploaded networks: their owners and sizes. Their roads lie in the data folder."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import BigInteger, String
from sqlalchemy.orm import Mapped, mapped_column

from dohyo.service.database.base import Base, now


class UploadedNetwork(Base):
    """A network that an owner has uploaded, or a name that the job of an import has claimed."""

    __tablename__ = "networks"

    name: Mapped[str] = mapped_column(String(63), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100), index=True)
    kept_bytes: Mapped[int] = mapped_column(BigInteger)
    claim: Mapped[str | None] = mapped_column(String(40))  # the job that imports it; None: it is complete
    created: Mapped[datetime] = mapped_column(default=now)
