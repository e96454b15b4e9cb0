"""Rankings: how runs on one benchmark version count, and the stored results of complete runs."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Any

from sqlalchemy import ForeignKey, Index, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from dohyo.service.database.base import Base, now


class Counts(StrEnum):
    """Which run of an entrant is its place, once it is complete.

    FIRST: the one ordered first, also where it was cancelled: it may be resumed. BEST: the one of the highest headline
    score. An entrant is a team. In an open ranking it is an agent: FIRST then holds for each of its versions, of which
    the best is its place. After an upgrade of dohyo the first is that of the runs which the new version drives.
    """

    BEST = "best"
    FIRST = "first"


class Audience(StrEnum):
    """Who may read, besides administrators, the challenge's organiser, and the runner of an own run.

    PUBLIC: all readers of the service. PARTICIPANTS: members of the challenge's teams. ORGANISERS: nobody else.
    """

    PUBLIC = "public"
    PARTICIPANTS = "participants"
    ORGANISERS = "organisers"


class Ranking(Base):
    """How runs on one benchmark version count on this server. All runs of a ranking have the same conditions.

    Every benchmark version has an open ranking, which never ends. A ranking of a challenge is a *phase*.

    Attributes:
        id: Identifier; that of an open ranking follows from the benchmark's version.
        challenge_id: Challenge of the phase; None for an open ranking.
        name: Name of the phase, unique in its challenge.
        benchmark_sha256: Benchmark version.
        seeds: Seeds that every run drives.
        secret: Whether seeds, scenarios, replays and records are withheld until `ends`.
        act_deadline_s: Wall-clock time for one decision, s.
        slow_policy: "wait" or "realtime".
        track: Only submissions on this track; None: on any track.
        verified_only: Whether only agents that the service itself runs (built-in, ONNX) may enter.
        runs_per_period: Most runs that an entrant may order in a period.
        period_s: Length of that period, s, which ends now.
        counts: Which run is an entrant's place, once it is complete.
        opens: Earliest time of an order; None: at once.
        closes: Latest time of an order; None: never.
        ends: Latest time at which a run is complete and counts; the board is final from then on. None: never.
        board: Who may see the board and that a run exists.
        replays: Who may see replays, explanations and infractions of others.
        records: Who may read records, trajectories and scores of single drives of others.
        final: `headline` and `rows` of the final board, stored after `ends`; None before.
        finalised: Time at which the board became final. None beside `final`: the phase had not ended, see `reopen`.
    """

    __tablename__ = "rankings"
    __table_args__ = (UniqueConstraint("challenge_id", "name"),)

    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    challenge_id: Mapped[str | None] = mapped_column(ForeignKey("challenges.id"), index=True)
    name: Mapped[str] = mapped_column(String(100), default="")
    benchmark_sha256: Mapped[str] = mapped_column(ForeignKey("benchmarks.sha256"), index=True)
    seeds: Mapped[list[int]]
    secret: Mapped[bool] = mapped_column(default=False)
    act_deadline_s: Mapped[float]
    slow_policy: Mapped[str] = mapped_column(String(10), default="wait")
    track: Mapped[str | None] = mapped_column(String(20))
    verified_only: Mapped[bool] = mapped_column(default=False)
    runs_per_period: Mapped[int]
    period_s: Mapped[float]
    counts: Mapped[Counts] = mapped_column(default=Counts.FIRST)
    opens: Mapped[datetime | None]
    closes: Mapped[datetime | None]
    ends: Mapped[datetime | None] = mapped_column(index=True)
    board: Mapped[Audience] = mapped_column(default=Audience.PUBLIC)
    replays: Mapped[Audience] = mapped_column(default=Audience.PUBLIC)
    records: Mapped[Audience] = mapped_column(default=Audience.PUBLIC)
    final: Mapped[dict[str, Any] | None]
    finalised: Mapped[datetime | None]
    created: Mapped[datetime] = mapped_column(default=now)

    def ended(self, at: datetime | None = None) -> bool:
        """Whether the board is final."""
        return self.ends is not None and self.ends <= (at or now())

    def withheld(self, at: datetime | None = None) -> bool:
        """Whether seeds, scenarios, replays and records are secret now."""
        return self.secret and not self.ended(at)


class Result(Base):
    """Scores of a complete ranked run, computed once from its episodes' summaries, so that a board reads thousands.

    Attributes:
        evaluation_id: The run.
        ranking_id: Its ranking.
        entrant: Identifier of what `Counts.FIRST` holds for: the team in a challenge, else the submission (also of a
            baseline).
        track: Which sensors the agent may use.
        score: Mean of the headline score.
        finished: Time of its end.
        facts: `scores` with intervals, `per_km`, numbers of `drives` and `episodes` that count and of `lost` drives,
            and `values`: the mean headline score of the egos of each episode, in the same order for every run, None for
            a lost one; empty where a drive that counts has none, or no drive counts: such a run has no place.
    """

    __tablename__ = "results"
    __table_args__ = (Index("by_end", "ranking_id", "finished"),)

    evaluation_id: Mapped[str] = mapped_column(ForeignKey("evaluations.id", ondelete="CASCADE"), primary_key=True)
    ranking_id: Mapped[str] = mapped_column(ForeignKey("rankings.id"))
    entrant: Mapped[str] = mapped_column(String(32))
    track: Mapped[str] = mapped_column(String(20))
    score: Mapped[float]
    finished: Mapped[datetime]
    facts: Mapped[dict[str, Any]]
