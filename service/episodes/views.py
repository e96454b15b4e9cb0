"""Answers of the episode routes."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

from pydantic import Field

from dohyo.service.evaluations.model import Episode, EpisodeStatus
from dohyo.service.web.views import View


class EpisodeView(View):
    """One scenario of an evaluation. Where the records are withheld, so are the scenario and all that tells of it."""

    id: Annotated[str, Field(description="Identifier.", examples=["ep-9f86d081884c7d65"])]
    evaluation: Annotated[str, Field(description="Its evaluation.")]
    position: Annotated[int, Field(description="In the benchmark's order, from 0.")]
    scenario: Annotated[str | None, Field(description="Name of the scenario; null where withheld.")]
    cell: Annotated[str | None, Field(description="Cell of the benchmark; null where withheld.")]
    seed: Annotated[int | None, Field(description="Of the scenario; null where withheld.")]
    status: Annotated[EpisodeStatus, Field(description="Status; lost: a fault of the infrastructure.")]
    attempts: Annotated[int, Field(description="How often it was started.")]
    record_hash: Annotated[str | None, Field(description="Content hash of its record; null where withheld.")]
    summary: Annotated[
        dict[str, Any] | None, Field(description="Scores and counts per ego, from the record; null where withheld.")
    ]
    failure: Annotated[str | None, Field(description="Why it was lost; null where withheld.")]
    started: Annotated[datetime | None, Field(description="Start of the last attempt.")]
    finished: Annotated[datetime | None, Field(description="Its end.")]


WITHHELD = ("scenario", "cell", "seed", "record_hash", "summary", "failure")


def view_episode(episode: Episode, *, told: bool = True) -> EpisodeView:
    """An episode.

    Args:
        episode: The episode.
        told: Whether the reader may see its record; without it, the properties in `WITHHELD` are None.
    """
    names = [name for name in EpisodeView.model_fields if name != "evaluation"]
    facts = {name: getattr(episode, name) if told or name not in WITHHELD else None for name in names}
    return EpisodeView(evaluation=episode.evaluation_id, **facts)
