"""Jobs: listed, followed, cancelled."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Header, Request, Response
from fastapi.concurrency import run_in_threadpool

from dohyo.service.accounts.access import Caller, Holder, Submitter
from dohyo.service.errors import NotFoundError
from dohyo.service.jobs import queries
from dohyo.service.jobs.model import JobStatus
from dohyo.service.jobs.orders import read_job
from dohyo.service.jobs.views import JobView, view_job
from dohyo.service.state import Services, ServicesOf
from dohyo.service.web.documents import After, Identifier, Limit, problems
from dohyo.service.web.events import MEDIA_TYPE, EventResponse, stream
from dohyo.service.web.views import Page

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])


@router.get("", responses=problems())
def list_jobs(
    caller: Holder, services: ServicesOf, status: JobStatus | None = None, limit: Limit = 50, after: After = None
) -> Page[JobView]:
    """Lists the caller's jobs, an administrator's all, the newest first."""
    owner = None if caller.is_admin else caller.owner
    with services.database.reading() as session:
        rows = queries.list_jobs(session, owner, status=status, limit=limit + 1, after=after)
        ahead = queries.count_ahead(session, rows[:limit])
        items = [view_job(job, ahead.get(job.id)) for job in rows[:limit]]
    return Page(items=items, next=items[-1].id if len(rows) > limit else None)


@router.get("/{identifier}", responses=problems(404))
def get_job(identifier: Identifier, caller: Holder, services: ServicesOf) -> JobView:
    """Status of a job."""
    return _state(services, caller, identifier)


@router.get(
    "/{identifier}/events",
    response_class=Response,
    responses=problems(404)
    | {
        200: {"description": "Events `state`, `end`, each with the whole job.", "content": {MEDIA_TYPE: {}}},
        204: {"description": "There is nothing more to tell."},
    },
)
async def stream_job_events(
    identifier: Identifier,
    request: Request,
    caller: Holder,
    services: ServicesOf,
    last_event_id: Annotated[str, Header(include_in_schema=False)] = "",
) -> Response:
    """Streams a job as server-sent events: `state` for each change, `end` at its end; each has the whole job."""
    state = await run_in_threadpool(_state, services, caller, identifier)
    if last_event_id == "end" and state.status.finished:
        return Response(status_code=204)

    async def read() -> JobView:
        return await run_in_threadpool(read_job, services, identifier)

    events: AsyncIterator[str] = stream(services.events, f"job:{identifier}", read)
    return EventResponse(request, events)


@router.delete("/{identifier}", status_code=204, responses=problems(403, 404))
async def delete_job(identifier: Identifier, caller: Submitter, services: ServicesOf) -> None:
    """Cancels an unfinished job, which stays readable; deletes a finished one."""
    state = await run_in_threadpool(_state, services, caller, identifier)
    if state.status.finished:
        await run_in_threadpool(_delete, services, identifier)
    else:
        await services.jobs.cancel(identifier)


def _state(services: Services, caller: Caller, identifier: str) -> JobView:
    with services.database.reading() as session:
        job = queries.find_job(session, identifier)
        if job is None or not caller.owns(job.owner):
            raise NotFoundError(f"no job '{identifier}'")
        return view_job(job, queries.count_ahead(session, [job]).get(job.id))


def _delete(services: Services, identifier: str) -> None:
    with services.database.session() as session:
        queries.delete_job(session, identifier)
