"""Usage: bytes that an owner keeps, and the limit of them."""

from __future__ import annotations

import time
from typing import Final

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from dohyo.service.errors import StorageFullError
from dohyo.service.evaluations.model import Episode, Evaluation
from dohyo.service.jobs.model import UNFINISHED, Job
from dohyo.service.networks.model import UploadedNetwork
from dohyo.service.submissions.model import Agent, Submission
from dohyo.service.worlds.model import World

MEGABYTE = 1_000_000
REUSED_S: Final = 60.0  # an owner with 50,000 episodes takes half a second to sum
LARGE_RECORD: Final = 10 * MEGABYTE


def kept_bytes(session: Session, owner: str) -> int:
    """Size of an owner's records of episodes and worlds, policies, networks, and files that jobs will check, bytes."""
    sums = (
        select(func.sum(Episode.kept_bytes)).join(Evaluation).where(Evaluation.owner == owner),
        select(func.sum(Submission.kept_bytes)).join(Agent).where(Agent.owner == owner),
        select(func.sum(UploadedNetwork.kept_bytes)).where(UploadedNetwork.owner == owner),
        select(func.sum(World.kept_bytes)).where(World.owner == owner),
        select(func.sum(Job.upload_bytes)).where(Job.owner == owner, Job.status.in_(UNFINISHED)),
    )
    return sum(int(session.scalar(query) or 0) for query in sums)


def check_bytes(session: Session, owner: str, limit: int, more: int = 0) -> int:
    """Refuses more than an owner may keep; returns how many bytes are left.

    Args:
        session: To read in.
        owner: Owner of what is to be stored.
        limit: Most bytes of one owner.
        more: Bytes to be stored.

    Raises:
        StorageFullError: The owner keeps too much already, or would.
    """
    kept = kept_bytes(session, owner)
    if kept + more > limit or kept >= limit:
        raise StorageFullError(
            f"you keep {kept / MEGABYTE:.1f} MB of at most {limit / MEGABYTE:.1f} MB, and this needs"
            f" {more / MEGABYTE:.1f} MB; delete evaluations, submissions or networks first"
        )
    return limit - kept - more


class EpisodeCheck:
    """Checks before each episode that its owner may keep more.

    A sum is reused for `REUSED_S`, as long as the episodes that began since cannot have filled the rest with records of
    `LARGE_RECORD`. So an owner who stores something else meanwhile exceeds the limit by the records of the episodes
    that begin within that time, and any other owner by those of the episodes that are being driven.
    """

    def __init__(self, limit: int) -> None:
        """Begins without sums, with the most bytes of one owner."""
        self._limit = limit
        self._sums: dict[str, tuple[float, int]] = {}  # until when a sum counts, and for how many further episodes

    def check(self, session: Session, owner: str) -> None:
        """Refuses another episode of an owner who keeps too much.

        Raises:
            StorageFullError: The owner keeps too much.
        """
        at = time.monotonic()
        until, episodes = self._sums.get(owner, (at, 0))
        if episodes <= 0 or at >= until:
            until, episodes = at + REUSED_S, check_bytes(session, owner, self._limit) // LARGE_RECORD
        self._sums[owner] = until, episodes - 1
