"""The wire of policy workers: register, acquire an episode, step it, and release it.

Bodies are msgpack or JSON (see `dohyo.service.wire.messages`), decoded by hand: a step has neither models nor
dependencies of the web framework on its way, and touches no database.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, Path, Query, Request, Response
from starlette.routing import Route
from starlette.types import Receive, Scope, Send

from dohyo.evaluation.episode.guarded_agent import RESET_DEADLINE_S
from dohyo.service.accounts.access import Caller, WorkerCaller
from dohyo.service.accounts.model import Token
from dohyo.service.accounts.queries import is_valid
from dohyo.service.database.engine import Database
from dohyo.service.errors import BusyError, NotFoundError, ServiceError, UnauthorisedError
from dohyo.service.running.channel import SEEN, Fault
from dohyo.service.state import Services, ServicesOf
from dohyo.service.submissions.queries import find_agent, find_submission
from dohyo.service.web.bodies.strict_json import readable
from dohyo.service.web.documents import problems
from dohyo.service.wire import openapi as schema
from dohyo.service.wire.bodies import LONGEST_TEXT, Granted, Registered, Registration, Release
from dohyo.service.wire.messages import decode, decode_step, encode
from dohyo.service.wire.requests import bearer_of, body_of, encoded, formats_of, headers_of, problem_of
from dohyo.service.workers.lease import Lease, Worker
from dohyo.service.workers.leases import LeaseBook
from dohyo.sumo_networks.errors import InvalidInputError

LONGEST_WAIT_S = 60.0

router = APIRouter(prefix="/v1", tags=["workers"])

LeaseId = Annotated[str, Path(max_length=40, examples=["l-3f9a1c0b7d2e4f5a6b7c8d9e"])]
WorkerId = Annotated[str, Path(max_length=40, examples=["w-9f86d081884c7d65"])]


class Steps:
    """POST /v1/leases/{lease}/step as a bare ASGI application: it is called ten times a simulated second."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers one step."""
        leases: LeaseBook = scope["app"].state.services.scheduler.leases
        headers = headers_of(scope)
        try:
            worker = leases.worker_of(bearer_of(headers))
            body = await body_of(headers, receive)
            taken, answered = formats_of(headers)
            lease = leases.lease_of(worker, scope["path_params"]["lease"])
            reply = await leases.step(lease, decode_step(body, taken), taken)
        except (ServiceError, InvalidInputError) as error:
            await problem_of(error)(scope, receive, send)
            return
        content = await encoded(reply, answered, reply.observations)
        length = str(len(content)).encode()
        about = [(b"content-type", answered.encode()), (b"content-length", length)]
        await send({"type": "http.response.start", "status": 200, "headers": about})
        await send({"type": "http.response.body", "body": content})


@router.post(
    "/workers",
    status_code=201,
    summary="Register a policy worker",
    openapi_extra=schema.REGISTER,
    responses={**problems(403, 404, 413), 201: schema.REGISTERED},
    response_class=Response,
)
async def register_worker(request: Request, caller: WorkerCaller, services: ServicesOf) -> Response:
    """Registers a worker for an agent of the token's owner; later requests need the token from this answer."""
    headers = headers_of(request.scope)
    try:
        taken, answered = formats_of(headers)
        order = _registration(decode(await body_of(headers, request.receive), taken))
        owner = await asyncio.to_thread(_owner_of, services.database, caller, order)
        leases = services.scheduler.leases
        worker = leases.register(order.agent, owner, caller.token_id or "", order.capacity, order.version)
    except (ServiceError, InvalidInputError) as error:
        return problem_of(error)
    answer = Registered(worker.id, worker.token, leases.lease_ttl_s)
    return Response(encode(answer, answered), 201, media_type=answered)


@router.post(
    "/workers/{worker_id}/acquire",
    summary="Wait for an episode to drive",
    openapi_extra=schema.WORKER_TOKEN,
    responses={**problems(404, 409, 413), 200: schema.ACQUIRED, 204: {"description": "None came in time; ask again."}},
    response_class=Response,
)
async def acquire_episode(
    worker_id: WorkerId,
    request: Request,
    services: ServicesOf,
    wait: Annotated[float, Query(ge=0.0, le=LONGEST_WAIT_S, description="Seconds to wait for one.")] = 20.0,
) -> Response:
    """Waits for an episode and leases it, with the first observations; 204 where none is available in time."""
    headers, leases = headers_of(request.scope), services.scheduler.leases
    try:
        worker = leases.worker_of(bearer_of(headers))
        if worker.id != worker_id:
            raise NotFoundError(f"no worker '{worker_id}' of this token")
        await body_of(headers, request.receive)
        if not await asyncio.to_thread(_is_good, services.database, worker.token_id):
            leases.dismiss(worker.token_id)
            raise UnauthorisedError("the token that this worker was registered with is no longer good")
        async with _departure(request.receive) as left:
            lease = await leases.acquire(worker, wait, left)
        if lease is None and leases.draining:
            raise BusyError("the service is ending", retry_s=5)
    except (ServiceError, InvalidInputError) as error:
        return problem_of(error)
    if lease is None:
        return Response(status_code=204)
    answered = formats_of(headers)[1]
    given = _given(lease)
    return Response(await encoded(given, answered, given.observations), media_type=answered)


step_route = Route("/v1/leases/{lease}/step", Steps(), methods=["POST"], include_in_schema=False)
"""Puts the route of a step before all others, since the search through them costs as much as a step."""


@router.post(
    "/leases/{lease}/step",
    summary="Send actions, get the next observations",
    openapi_extra=schema.STEP,
    responses={**problems(409, 410, 413), 200: schema.STEPPED},
    response_class=Response,
)
async def step_episode(lease: LeaseId) -> Response:
    """Drives all egos of the lease for one tick, which lasts `dt_s`. A repeated tick gets the same answer.

    A tick is 0.1 s of simulated time on roads and in parking lots, and 60 s on freeway mornings and days of forecasts.
    """
    raise AssertionError("unreachable: `step_route` is asked before this one, which is only read as a document")


@router.post(
    "/leases/{lease}/heartbeat",
    status_code=204,
    summary="Keep a lease while deciding for long",
    openapi_extra=schema.WORKER_TOKEN,
    responses={**problems(410, 413), 204: {"description": "Renewed."}},
    response_class=Response,
)
async def renew_lease(lease: LeaseId, request: Request, services: ServicesOf) -> Response:
    """Renews a lease, as every step does; for workers that load a model or decide for longer than the lease lasts."""
    try:
        worker, leases = await _caller(request, services)
        leases.heartbeat(leases.lease_of(worker, lease))
    except (ServiceError, InvalidInputError) as error:
        return problem_of(error)
    return Response(status_code=204)


@router.post(
    "/leases/{lease}/release",
    status_code=204,
    summary="Give an episode back",
    openapi_extra=schema.RELEASE,
    responses={**problems(410, 413), 204: {"description": "Released."}},
    response_class=Response,
)
async def release_lease(lease: LeaseId, request: Request, services: ServicesOf) -> Response:
    """Ends a lease: with an `error` by the agent's fault, otherwise another worker drives the episode again."""
    headers = headers_of(request.scope)
    try:
        leases = services.scheduler.leases
        worker = leases.worker_of(bearer_of(headers))
        body = await body_of(headers, request.receive)
        fault, text = _reason(decode(body, formats_of(headers)[0]) if body else {})
        leases.release(leases.lease_of(worker, lease), fault, text)
    except (ServiceError, InvalidInputError) as error:
        return problem_of(error)
    return Response(status_code=204)


def _registration(document: Any) -> Registration:
    try:
        return msgspec.convert(document, Registration)
    except msgspec.ValidationError as error:
        raise InvalidInputError(f"expected {{agent, capacity, version}}: {error}") from None


def _reason(document: Any) -> tuple[Fault | None, str]:
    """Fault of a release, and its text for the record."""
    try:
        given = msgspec.convert(document, Release)
    except msgspec.ValidationError as error:
        raise InvalidInputError(f"expected {{reason, error}}: {error}") from None
    text = readable(given.reason if given.error is None else given.error[:LONGEST_TEXT]).strip() or "no reason given"
    if given.error is None:
        return None, text
    return (Fault.INVALID_ACTION if given.reason == Fault.INVALID_ACTION else Fault.RAISED), text


def _given(lease: Lease) -> Granted:
    """The answer that grants a lease."""
    order, episode = lease.episode.order, lease.episode
    return Granted(
        **order.told(episode.version),
        lease=lease.id,
        attempt=episode.attempt,
        deadline_ms=round(order.act_deadline_s * 1000),
        first_deadline_ms=round(RESET_DEADLINE_S * 1000),
        slow_policy=order.slow_policy,
        tick=lease.tick,
        observations=msgspec.Raw(memoryview(episode.frame)[SEEN.size :]),
    )


async def _caller(request: Request, services: Services) -> tuple[Worker, LeaseBook]:
    headers, leases = headers_of(request.scope), services.scheduler.leases
    worker = leases.worker_of(bearer_of(headers))
    await body_of(headers, request.receive)
    return worker, leases


@asynccontextmanager
async def _departure(receive: Receive) -> AsyncIterator[asyncio.Future[None]]:
    """Returns once the client has closed its connection."""

    async def wait() -> None:
        while (await receive())["type"] != "http.disconnect":
            pass

    task = asyncio.ensure_future(wait())
    try:
        yield task
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


def _owner_of(database: Database, caller: Caller, order: Registration) -> str:
    """Owner of the agent for which a worker registers.

    Raises:
        NotFoundError: The caller has no such agent, or the agent no such version, for which the worker would wait.
    """
    with database.reading() as session:
        agent = find_agent(session, order.agent)
        if agent is None or not caller.owns(agent.owner):
            raise NotFoundError(f"no agent named '{order.agent}' of yours")
        if order.version is not None and find_submission(session, agent, order.version) is None:
            raise NotFoundError(f"agent '{order.agent}' has no version {order.version}")
        return agent.owner


def _is_good(database: Database, token_id: str) -> bool:
    with database.reading() as session:
        return is_valid(session.get(Token, token_id))
