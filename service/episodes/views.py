"""Answers of the episode routes."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

from pydantic import Field

from dohyo.service.evaluations.model import Episode, EpisodeStatus
from dohyo.service.web.views import View


class EpisodeView(View):
    """One scenario of an evaluation."""

    id: Annotated[str, Field(examples=["ep-9f86d081884c7d65"])]
    evaluation: str
    position: Annotated[int, Field(description="In the benchmark's order, from 0.")]
    scenario: str
    cell: str
    seed: int
    status: EpisodeStatus
    attempts: int
    record_hash: str | None
    summary: Annotated[dict[str, Any] | None, Field(description="Scores and counts per ego, from the record.")]
    failure: str | None
    started: datetime | None
    finished: datetime | None


def view_episode(episode: Episode) -> EpisodeView:
    """An episode."""
    return EpisodeView(
        evaluation=episode.evaluation_id,
        **{name: getattr(episode, name) for name in EpisodeView.model_fields if name != "evaluation"},
    )
