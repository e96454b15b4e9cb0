"""Answers of the episode routes."""

from __future__ import annotations

from collections.abc import Set
from datetime import datetime
from typing import Annotated, Any

from pydantic import Field

from dohyo.service.evaluations.model import Attempt, AttemptOutcome, Episode, EpisodeStatus
from dohyo.service.web.views import View

UNTOLD = {"status": EpisodeStatus.QUEUED, "attempts": 0, "failure": None, "started": None, "finished": None}
"""What is shown of an episode whose status is hidden while its evaluation lasts."""


class EpisodeView(View):
    """One scenario of an evaluation. Where the records are withheld, so are the scenario and all that tells of it."""

    id: Annotated[str, Field(description="Identifier.", examples=["ep-9f86d081884c7d65"])]
    evaluation: Annotated[str, Field(description="Its evaluation.")]
    position: Annotated[int, Field(description="In the benchmark's order, from 0.")]
    scenario: Annotated[str | None, Field(description="Name of the scenario; null where withheld.")]
    cell: Annotated[str | None, Field(description="Cell of the benchmark; null where withheld.")]
    seed: Annotated[int | None, Field(description="Of the scenario; null where withheld.")]
    status: Annotated[
        EpisodeStatus,
        Field(
            description="Status; done: it has a record, also of a gridlock, which the statuses in `summary` tell. "
            "lost: a fault of the infrastructure. Of a remote agent `queued` until the episode is done or the "
            "evaluation has ended, so that a worker does not learn which scenario it drives; where the records are "
            "withheld, `queued` until the evaluation has ended."
        ),
    ]
    attempts: Annotated[
        int,
        Field(
            description="How often it was started, without the starts whose outcome is `unclaimed` or `drained`, which "
            "the list of attempts has too."
        ),
    ]
    record_hash: Annotated[str | None, Field(description="Content hash of its record; null where withheld.")]
    summary: Annotated[
        dict[str, Any] | None,
        Field(
            description="Scores and counts per ego, from the record; null where withheld. In `forecast` of a day, "
            "`rmse_1` to `rmse_3` are squares in km^2/h^2: the scores of an evaluation are roots of their means."
        ),
    ]
    failure: Annotated[str | None, Field(description="Why it was lost; null unless it is, and where withheld.")]
    started: Annotated[datetime | None, Field(description="Start of the last attempt; null where withheld.")]
    finished: Annotated[datetime | None, Field(description="Its end; null where withheld.")]


WITHHELD = ("scenario", "cell", "seed", "record_hash", "summary", "failure", "started", "finished")


def view_episode(episode: Episode, *, told: bool = True, hidden: Set[EpisodeStatus] = frozenset()) -> EpisodeView:
    """An episode.

    Args:
        episode: The episode.
        told: Whether the reader may see its record; without it, the properties in `WITHHELD` are None.
        hidden: Statuses that the answer must not tell, see `Evaluation.hidden_statuses`.
    """
    names = [name for name in EpisodeView.model_fields if name != "evaluation"]
    facts = {name: getattr(episode, name) if told or name not in WITHHELD else None for name in names}
    if episode.status is not EpisodeStatus.LOST:  # the reason of an earlier attempt, which the list of attempts has
        facts["failure"] = None
    if episode.status in hidden:
        facts |= UNTOLD
    return EpisodeView(evaluation=episode.evaluation_id, **facts)


class AttemptView(View):
    """One start of an episode."""

    number: Annotated[int, Field(description="In the order of the starts, from 1.")]
    started: Annotated[datetime | None, Field(description="Its start; null where withheld.")]
    ended: Annotated[datetime | None, Field(description="Its end; null while it runs, and where withheld.")]
    outcome: Annotated[
        AttemptOutcome | None,
        Field(
            description="Kind of its end; null while it runs. done: a record. agent_failed: the same, with "
            "a fault of the agent; shown as done where the records are withheld. worker_gone: the policy worker fell "
            "silent. given_back: the policy worker released the episode. machine: the process died. simulation: SUMO "
            "failed, or the disk. unclaimed: no worker came. drained: the service ended. cancelled: the evaluation was "
            "cancelled."
        ),
    ]
    why: Annotated[str | None, Field(description="Reason of the end, for people; null where withheld.")]
    charged: Annotated[bool, Field(description="Whether it counts against the submission.")]
    processor_s: Annotated[
        float | None, Field(description="Processor time of the episode's process, s; null where withheld.")
    ]


def view_attempt(attempt: Attempt, *, told: bool) -> AttemptView:
    """An attempt; without `told`, nothing in it says how the drive went."""
    facts = {name: getattr(attempt, name) for name in AttemptView.model_fields}
    if not told:
        facts |= dict.fromkeys(("started", "ended", "why", "processor_s"))
        if attempt.outcome is AttemptOutcome.AGENT_FAILED:
            facts["outcome"] = AttemptOutcome.DONE
    return AttemptView(**facts)
