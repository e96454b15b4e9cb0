"""Claims: the name of a network belongs to the job that imports it, from before the work until its end."""

from __future__ import annotations

from sqlalchemy.orm import Session

from dohyo.service.errors import ConflictError
from dohyo.service.jobs.model import UNFINISHED, Job
from dohyo.service.networks.finding import check_free
from dohyo.service.networks.model import UploadedNetwork


def claim_name(session: Session, name: str, owner: str, job_id: str) -> bool:
    """Claims the name of a new network for a job; whether an earlier start of the job had claimed it.

    Raises:
        InvalidInputError: The name is invalid.
        ConflictError: There is such a network, or another job imports it.
        TooManyRequestsError: The catalog is full.
    """
    row = session.get(UploadedNetwork, name)
    if row is not None and row.claim == job_id:
        return True
    if row is not None and (row.claim is None or _is_unfinished(session, row.claim)):
        raise ConflictError(f"network '{name}' exists or is being imported; choose another name")
    check_free(name)
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
