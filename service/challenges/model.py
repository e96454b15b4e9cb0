"""Challenges and their teams, members, invitations and baselines. The phases are rankings (`boards/model.py`)."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import ForeignKey, String, Text, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from dohyo.service.database.base import Base, now


class Challenge(Base):
    """A competition on this server: rules, phases, teams. Only `owner` and administrators may change it."""

    __tablename__ = "challenges"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    name: Mapped[str] = mapped_column(String(100), unique=True)
    owner: Mapped[str] = mapped_column(String(100), index=True)
    title: Mapped[str] = mapped_column(String(200))
    rules: Mapped[str] = mapped_column(Text, default="")
    created: Mapped[datetime] = mapped_column(default=now)


class Team(Base):
    """Owners who compete together in a challenge; a run of any member counts for the team."""

    __tablename__ = "teams"
    __table_args__ = (UniqueConstraint("challenge_id", "name"),)

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    challenge_id: Mapped[str] = mapped_column(ForeignKey("challenges.id"), index=True)
    name: Mapped[str] = mapped_column(String(100))
    created: Mapped[datetime] = mapped_column(default=now)


class Member(Base):
    """An owner in a challenge, in exactly one team."""

    __tablename__ = "members"

    challenge_id: Mapped[str] = mapped_column(ForeignKey("challenges.id"), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100), primary_key=True, index=True)
    team_id: Mapped[str] = mapped_column(ForeignKey("teams.id"), index=True)
    joined: Mapped[datetime] = mapped_column(default=now)


class Invitation(Base):
    """A code that admits one owner to a challenge, once. Only the hash of the code is stored.

    `team` is the name of the team that it admits to; None: the team that its bearer chooses and makes.
    """

    __tablename__ = "invitations"

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    challenge_id: Mapped[str] = mapped_column(ForeignKey("challenges.id"), index=True)
    sha256: Mapped[str] = mapped_column(String(64), unique=True)
    team: Mapped[str | None] = mapped_column(String(100))
    note: Mapped[str] = mapped_column(String(200), default="")
    created: Mapped[datetime] = mapped_column(default=now)
    expires: Mapped[datetime]
    revoked: Mapped[datetime | None]
    redeemed: Mapped[datetime | None]
    redeemed_by: Mapped[str | None] = mapped_column(String(100))


class Baseline(Base):
    """A submission of the organiser whose runs stand on the challenge's boards without a rank."""

    __tablename__ = "baselines"

    challenge_id: Mapped[str] = mapped_column(ForeignKey("challenges.id"), primary_key=True)
    submission_id: Mapped[str] = mapped_column(ForeignKey("submissions.id"), primary_key=True)
    created: Mapped[datetime] = mapped_column(default=now)
