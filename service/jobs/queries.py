"""Jobs: queued, taken, ended. A change names the status that the job must have, so that a late one has no effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import delete, func, select, update
from sqlalchemy.orm import Session

from dohyo.service.database.base import now
from dohyo.service.database.pages import newest_first
from dohyo.service.jobs.kind import Made
from dohyo.service.jobs.model import UNFINISHED, Job, JobStatus


def add_job(
    session: Session,
    job_id: str,
    kind: str,
    owner: str,
    arguments: Mapping[str, Any],
    *,
    subject: str | None = None,
    upload_bytes: int = 0,
) -> Job:
    """Queues a job."""
    job = Job(id=job_id, kind=kind, owner=owner, arguments=dict(arguments), subject=subject, upload_bytes=upload_bytes)
    session.add(job)
    session.flush()
    return job


def last_about(session: Session, owner: str, kind: str, subject: str) -> Job | None:
    """The newest job of an owner and kind with a subject."""
    query = select(Job).where(Job.owner == owner, Job.kind == kind, Job.subject == subject)
    return session.scalars(query.order_by(Job.created.desc(), Job.id.desc()).limit(1)).first()


def find_job(session: Session, job_id: str) -> Job | None:
    """A job by its identifier."""
    return session.get(Job, job_id)


def list_jobs(
    session: Session,
    owner: str | None,
    *,
    status: JobStatus | None = None,
    limit: int | None = None,
    after: str | None = None,
) -> Sequence[Job]:
    """Jobs, the newest first, those older than `after`.

    Args:
        session: To read in.
        owner: Only jobs of this owner; None: of all owners.
        status: Only jobs of this status.
        limit: Largest number of results.
        after: Identifier of a job; an unknown one gives none.
    """
    query = newest_first(session, select(Job), Job, limit, after)
    if owner is not None:
        query = query.where(Job.owner == owner)
    if status is not None:
        query = query.where(Job.status == status)
    return session.scalars(query).all()


def count_unfinished(session: Session, owner: str | None = None) -> int:
    """Number of unfinished jobs of an owner; None: of all owners."""
    query = select(func.count()).select_from(Job).where(Job.status.in_(UNFINISHED))
    return session.scalar(query if owner is None else query.where(Job.owner == owner)) or 0


def count_by_status(session: Session) -> Mapping[str, int]:
    """Number of jobs of all owners by status."""
    rows = session.execute(select(Job.status, func.count()).group_by(Job.status))
    return {status.value: count for status, count in rows}


def count_ahead(session: Session, jobs: Sequence[Job]) -> Mapping[str, int]:
    """For each queued one of some jobs, the number of queued jobs of all owners that were ordered before it."""
    mine = [job.id for job in jobs if job.status is JobStatus.QUEUED]
    if not mine:
        return {}
    place = func.row_number().over(order_by=(Job.created, Job.id)).label("place")
    queued = select(Job.id, place).where(Job.status == JobStatus.QUEUED).subquery()
    return {job: place - 1 for job, place in session.execute(select(queued).where(queued.c.id.in_(mine)))}


def first_of_each_owner(session: Session) -> Sequence[Job]:
    """The oldest queued job of each owner, the oldest first."""
    order = func.row_number().over(partition_by=Job.owner, order_by=(Job.created, Job.id)).label("place")
    ranked = select(Job.id, order).where(Job.status == JobStatus.QUEUED).subquery()
    query = select(Job).join(ranked, ranked.c.id == Job.id).where(ranked.c.place == 1)
    return session.scalars(query.order_by(Job.created, Job.id)).all()


def start(session: Session, job_id: str) -> bool:
    """Starts a queued job; False: it is no longer queued."""
    return _change(session, job_id, (JobStatus.QUEUED,), status=JobStatus.RUNNING, started=now(), starts=Job.starts + 1)


def finish(session: Session, job_id: str, made: Made) -> bool:
    """Stores the result of a running job; False: it no longer runs."""
    return _end(session, job_id, JobStatus.DONE, answer=made.answer, result=made.result)


def fail(session: Session, job_id: str, problem: dict[str, Any]) -> bool:
    """Stores why a running job failed; False: it no longer runs."""
    return _end(session, job_id, JobStatus.FAILED, problem=problem)


def cancel(session: Session, job_id: str) -> bool:
    """Cancels a job; False: it has ended already."""
    return _change(session, job_id, UNFINISHED, status=JobStatus.CANCELLED, finished=now())


def requeue(session: Session, job_id: str) -> bool:
    """Queues a running job again, as the service stops; the start does not count."""
    wanted = {"status": JobStatus.QUEUED, "started": None, "starts": Job.starts - 1}
    return _change(session, job_id, (JobStatus.RUNNING,), **wanted)


def queue_again(session: Session, job_id: str) -> bool:
    """Queues a job again that ran when the service died; the start counts."""
    return _change(session, job_id, (JobStatus.RUNNING,), status=JobStatus.QUEUED, started=None)


def running(session: Session) -> Sequence[Job]:
    """Jobs that run, or ran when the service died."""
    return session.scalars(select(Job).where(Job.status == JobStatus.RUNNING)).all()


def unfinished(session: Session) -> set[str]:
    """Identifiers of all unfinished jobs."""
    return set(session.scalars(select(Job.id).where(Job.status.in_(UNFINISHED))))


def delete_job(session: Session, job_id: str) -> bool:
    """Deletes a finished job; False: it is not finished."""
    result: Any = session.execute(delete(Job).where(Job.id == job_id, Job.status.not_in(UNFINISHED)))
    return bool(result.rowcount)


def delete_before(session: Session, moment: datetime) -> int:
    """Deletes all jobs that finished before a moment; returns how many."""
    result: Any = session.execute(delete(Job).where(Job.status.not_in(UNFINISHED), Job.finished < moment))
    return int(result.rowcount)


def _end(session: Session, job_id: str, status: JobStatus, **values: Any) -> bool:
    return _change(session, job_id, (JobStatus.RUNNING,), status=status, finished=now(), **values)


def _change(session: Session, job_id: str, which: Sequence[JobStatus], **values: Any) -> bool:
    wanted = update(Job).where(Job.id == job_id, Job.status.in_(which)).values(**values)
    result: Any = session.execute(wanted.execution_options(synchronize_session=False))
    return bool(result.rowcount)
