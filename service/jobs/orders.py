"""Orders: a request that becomes a job, and its answer: 202 at once, or what the job made for `Prefer: wait`.

job = await order_job(services, caller.owner, "redrive", {"episode": identifier, "record": record_hash})
return await answer_job(services, job, wait_s)
"""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from fastapi import Depends, Header
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from sqlalchemy.orm import Session

from dohyo.service.database.base import new_id
from dohyo.service.database.engine import serialise
from dohyo.service.database.idempotency import made_before, remember
from dohyo.service.errors import BusyError, TooManyRequestsError, problem
from dohyo.service.jobs import queries
from dohyo.service.jobs.model import JobStatus
from dohyo.service.jobs.runner import upload_path
from dohyo.service.jobs.views import JobView, view_job
from dohyo.service.state import Services
from dohyo.service.storage.usage import check_bytes
from dohyo.service.web.documents import problems
from dohyo.sumo_networks.scenario import content_hash

LONGEST_WAIT_S = 30.0
RETRY_S = 1


def _wait_s(
    prefer: Annotated[
        str | None,
        Header(max_length=200, description="`wait=N`: answers once the job has ended, after N seconds (30) at most."),
    ] = None,
) -> float:
    """Seconds that the caller prefers to wait (RFC 7240); other preferences are ignored."""
    for preference in (prefer or "").split(","):
        name, _, value = preference.partition("=")
        if name.strip().lower() == "wait" and value.strip().isdecimal():
            return min(LONGEST_WAIT_S, float(value.strip()))
    return 0.0


Wait = Annotated[float, Depends(_wait_s)]


def ordered(model: type[BaseModel], *statuses: int, made: int = 201) -> dict[int | str, dict[str, Any]]:
    """The OpenAPI entry of a route that orders a job."""
    queued = {"model": JobView, "description": "Ordered; `Location` is the job's path."}
    done = {"model": model, "description": "Done, within the seconds of `Prefer: wait`."}
    return problems(403, *statuses) | {202: queued, made: done}


def check_room(services: Services, owner: str) -> None:
    """Refuses an order beyond the owner's share of the queue, before anything of it is read or stored.

    Raises:
        TooManyRequestsError: The owner has as many unfinished jobs as one may have.
        BusyError: The queue is full, or the service is shutting down.
    """
    with services.database.reading() as session:
        _check_room(session, services, owner)


async def order_job(
    services: Services,
    owner: str,
    kind: str,
    arguments: Mapping[str, Any],
    *,
    file: Path | None = None,
    key: str | None = None,
    subject: str | None = None,
) -> str:
    """Queues a job and returns its identifier; the same order with the same key queues only one.

    Args:
        services: Services of the app.
        owner: Owner whose share it uses.
        kind: Name in `dohyo.service.jobs.kinds`.
        arguments: Plain JSON, checked as far as that is cheap.
        file: Uploaded file, which is moved to the job.
        key: The request's `Idempotency-Key`; the arguments must then name an uploaded file's content, such as its hash.
        subject: What it is about: while a job of the same owner and kind about the same subject is unfinished, that one
            is returned.

    Raises:
        TooManyRequestsError: See `check_room`.
        BusyError: See `check_room`.
        InvalidInputError: The key was used for another request.
    """
    job_id = await run_in_threadpool(_order, services, owner, kind, arguments, file, key, subject)
    services.jobs.wake()
    return job_id


async def answer_job(services: Services, job_id: str, wait_s: float, made: int = 201) -> JSONResponse:
    """Answer of an order: what the job made or why it failed, if it ends within `wait_s`; else 202 with the job.

    Args:
        services: Services of the app.
        job_id: Identifier of the job.
        wait_s: Seconds that the caller prefers to wait.
        made: Status of the answer where the job is done.
    """
    view = await _ended(services, job_id, wait_s)
    applied = {"preference-applied": f"wait={wait_s:g}"} if wait_s else {}
    if view.status is JobStatus.DONE and wait_s:
        headers = applied | ({"location": view.result} if view.result else {})
        return JSONResponse(view.answer, made, headers)
    if view.status is JobStatus.FAILED and wait_s and view.failure is not None:
        members = {"errors": view.failure.errors} if view.failure.errors else {}
        retry = {"retry-after": str(RETRY_S)} if view.failure.status in (429, 503) else {}
        return problem(view.failure.status, view.failure.detail, applied | retry, **members)
    headers = {"location": f"/v1/jobs/{job_id}", "retry-after": str(RETRY_S)}
    return JSONResponse(view.model_dump(mode="json"), 202, headers)


def read_job(services: Services, job_id: str) -> JobView:
    """State of a job that exists."""
    with services.database.reading() as session:
        job = queries.find_job(session, job_id)
        assert job is not None, job_id
        return view_job(job, queries.count_ahead(session, [job]).get(job.id))


def last_about(services: Services, owner: str, kind: str, subject: str) -> JobView | None:
    """The newest job of an owner and kind about a subject."""
    with services.database.reading() as session:
        job = queries.last_about(session, owner, kind, subject)
        return view_job(job, None) if job is not None else None


def _order(
    services: Services,
    owner: str,
    kind: str,
    arguments: Mapping[str, Any],
    file: Path | None,
    key: str | None,
    subject: str | None,
) -> str:
    request = content_hash({"job": kind, "arguments": dict(arguments)})
    job_id, size = new_id("job"), file.stat().st_size if file is not None else 0
    kept = upload_path(services.settings, job_id)
    try:
        if file is not None:
            kept.parent.mkdir(parents=True, mode=0o700)
            shutil.move(file, kept)
        with services.database.session() as session:
            serialise(session)
            before = made_before(session, owner, key, request)
            if before is not None and queries.find_job(session, before) is not None:
                shutil.rmtree(kept.parent, ignore_errors=True)
                return before
            last = queries.last_about(session, owner, kind, subject) if subject is not None else None
            if last is not None and not last.status.finished:
                return last.id
            _check_room(session, services, owner)
            if file is not None:
                check_bytes(session, owner, services.settings.bytes_per_owner, size)
            queries.add_job(session, job_id, kind, owner, arguments, subject=subject, upload_bytes=size)
            remember(session, owner, key, request, job_id)
    except BaseException:
        shutil.rmtree(kept.parent, ignore_errors=True)
        raise
    return job_id


def _check_room(session: Session, services: Services, owner: str) -> None:
    settings = services.settings
    if services.draining:
        raise BusyError("the service is shutting down", retry_s=30)
    if queries.count_unfinished(session, owner) >= settings.jobs_per_owner:
        raise TooManyRequestsError(f"you have {settings.jobs_per_owner} unfinished jobs, the most there may be")
    if queries.count_unfinished(session) >= settings.jobs_limit:
        raise BusyError(f"the queue holds at most {settings.jobs_limit} jobs, and has no room", retry_s=30)


async def _ended(services: Services, job_id: str, wait_s: float) -> JobView:
    """State of a job at its end, or after `wait_s`."""
    with services.events.subscribe(f"job:{job_id}") as subscription:
        deadline = asyncio.get_running_loop().time() + wait_s
        view = await run_in_threadpool(read_job, services, job_id)
        while not view.status.finished and not subscription.closed:
            left_s = deadline - asyncio.get_running_loop().time()
            if left_s <= 0:
                break
            await subscription.get(left_s)
            view = await run_in_threadpool(read_job, services, job_id)
        return view
