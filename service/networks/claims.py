"""Claims: the name of a network belongs to the job that imports it, from before the work until its end."""

from __future__ import annotations

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from dohyo.service.database.engine import serialise
from dohyo.service.errors import ConflictError, TooManyRequestsError
from dohyo.service.jobs.model import UNFINISHED, Job
from dohyo.service.networks.finding import check_free
from dohyo.service.networks.model import UploadedNetwork


def claim_name(session: Session, name: str, owner: str, job_id: str, most: int) -> bool:
    """Claims the name of a new network for a job; whether an earlier start of the job had claimed it.

    Args:
        session: To write in.
        name: Name of the network.
        owner: Its owner.
        job_id: Identifier of the job.
        most: Most networks of one owner.

    Raises:
        InvalidInputError: The name is invalid.
        ConflictError: There is such a network, or another job imports it.
        TooManyRequestsError: The catalog is full, or the owner has too many networks.
    """
    serialise(session)
    row = session.get(UploadedNetwork, name)
    if row is not None and row.claim == job_id:
        return True
    if row is not None and (row.claim is None or _is_unfinished(session, row.claim)):
        raise ConflictError(f"network '{name}' exists or is being imported; choose another name")
    check_free(name)
    others = (UploadedNetwork.owner == owner, UploadedNetwork.name != name)
    if (session.scalar(select(func.count()).select_from(UploadedNetwork).where(*others)) or 0) >= most:
        raise TooManyRequestsError(f"you have {most} networks, the most of one owner; delete one", retry_s=3600)
    if row is not None:  # a claim that a crash has left
        session.delete(row)
        session.flush()
    session.add(UploadedNetwork(name=name, owner=owner, kept_bytes=0, claim=job_id))
    session.flush()  # the primary key refuses a simultaneous claim
    return False


def complete(session: Session, name: str, job_id: str, kept_bytes: int) -> None:
    """Notes that the network that a job claimed is in the catalog.

    Raises:
        ConflictError: Another job has claimed the name since, when this one was cancelled.
    """
    row = session.get(UploadedNetwork, name)
    if row is None or row.claim != job_id:
        raise ConflictError(f"network '{name}': the import was cancelled, and another one has the name")
    row.claim, row.kept_bytes = None, kept_bytes


def release(session: Session, name: str, job_id: str) -> None:
    """Frees a name if it is this job's: another one may have claimed it since, when this one was cancelled."""
    row = session.get(UploadedNetwork, name)
    if row is not None and row.claim == job_id:
        session.delete(row)


def _is_unfinished(session: Session, job_id: str) -> bool:
    job = session.get(Job, job_id)
    return job is not None and job.status in UNFINISHED
