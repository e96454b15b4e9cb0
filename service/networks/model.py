"""Uploaded networks: whose they are, and how large. Their roads lie in the data folder."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import BigInteger, String
from sqlalchemy.orm import Mapped, mapped_column

from dohyo.service.database.base import Base, now


class UploadedNetwork(Base):
    """A network that an owner has uploaded."""

    __tablename__ = "networks"

    name: Mapped[str] = mapped_column(String(63), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100), index=True)
    kept_bytes: Mapped[int] = mapped_column(BigInteger)
    created: Mapped[datetime] = mapped_column(default=now)
