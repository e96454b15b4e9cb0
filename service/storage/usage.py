"""Usage: bytes that an owner keeps, and the limit of them."""

from __future__ import annotations

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from dohyo.service.errors import StorageFullError
from dohyo.service.evaluations.model import Episode, Evaluation
from dohyo.service.jobs.model import UNFINISHED, Job
from dohyo.service.networks.model import UploadedNetwork
from dohyo.service.submissions.model import Agent, Submission
from dohyo.service.worlds.model import World

MEGABYTE = 1_000_000


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


def check_bytes(session: Session, owner: str, limit: int, more: int = 0) -> None:
    """Refuses more than an owner may keep.

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
