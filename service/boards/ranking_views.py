"""Answers about rankings."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field

from dohyo.service.boards.model import Audience, Counts, Ranking
from dohyo.service.web.views import Version, View


class RankingView(View):
    """How runs on one benchmark version count on this server. A ranking of a challenge is a phase."""

    id: Annotated[str, Field(description="Identifier.", examples=["rk-9f86d081884c7d65"])]
    challenge: Annotated[str | None, Field(description="Name of the challenge; null: open to all, without an end.")]
    name: Annotated[str, Field(description="Name of the phase; empty for an open ranking.", examples=["final"])]
    benchmark: Annotated[str, Field(description="Name of the benchmark.")]
    benchmark_version: Version
    state: Annotated[
        Literal["planned", "open", "closed", "final"],
        Field(
            description="planned: before `opens`; open: runs can be ordered; closed: runs that were ordered before may "
            "still end; final: the board never changes again."
        ),
    ]
    seeds: Annotated[list[int] | None, Field(description="Driven by every run; null while they are secret.")]
    seed_count: Annotated[int, Field(description="Number of seeds.")]
    secret: Annotated[
        bool, Field(description="Whether seeds, scenarios, replays and records are withheld until `ends`.")
    ]
    act_deadline_s: Annotated[float, Field(description="Wall-clock time for one decision, s.")]
    slow_policy: Annotated[str, Field(description="Whether the simulation waits for a remote agent.")]
    track: Annotated[str | None, Field(description="Only submissions on this track may enter; null: on any.")]
    verified_only: Annotated[
        bool, Field(description="Whether only agents that the service itself runs (built-in, ONNX) may enter.")
    ]
    runs_per_period: Annotated[
        int, Field(description="Most runs that a team (in an open ranking: an agent) may order within `period_s`.")
    ]
    period_s: Annotated[float, Field(description="Length of the period of `runs_per_period`, s; it ends now.")]
    counts: Annotated[
        Counts,
        Field(
            description="Which complete run is a team's place: its first, or its best by the headline. In an open "
            "ranking an agent's place is its best version, each with its first run."
        ),
    ]
    opens: Annotated[datetime | None, Field(description="Earliest time of an order; null: at once.")]
    closes: Annotated[datetime | None, Field(description="Latest time of an order; null: never.")]
    ends: Annotated[datetime | None, Field(description="Latest end of a run that counts; then the board is final.")]
    board: Annotated[Audience, Field(description="Who may see the board.")]
    replays: Annotated[Audience, Field(description="Who may see replays of others' runs, when they are not secret.")]
    records: Annotated[Audience, Field(description="Who may read records of others' runs, when they are not secret.")]
    board_visible: Annotated[bool, Field(description="Whether you may see the board.")]


def view_ranking(
    ranking: Ranking, benchmark: str, challenge: str | None, *, at: datetime, told: bool, board_visible: bool
) -> RankingView:
    """A ranking.

    Args:
        ranking: The ranking.
        benchmark: Name of its benchmark.
        challenge: Name of its challenge.
        at: The current time.
        told: Whether the reader may see secret seeds.
        board_visible: Whether the reader may see the board.
    """
    copied = {name: getattr(ranking, name) for name in RankingView.model_fields if name in Ranking.__mapper__.columns}
    copied["seeds"] = None if ranking.withheld(at) and not told else ranking.seeds
    return RankingView(
        **copied,
        challenge=challenge,
        benchmark=benchmark,
        benchmark_version=ranking.benchmark_sha256,
        state=_state(ranking, at),
        seed_count=len(ranking.seeds),
        board_visible=board_visible,
    )


def _state(ranking: Ranking, at: datetime) -> Literal["planned", "open", "closed", "final"]:
    if ranking.ended(at):
        return "final"
    if ranking.closes is not None and ranking.closes <= at:
        return "closed"
    return "planned" if ranking.opens is not None and at < ranking.opens else "open"
