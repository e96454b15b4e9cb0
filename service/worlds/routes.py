"""Worlds: start, pace, pause, reset and end live scenarios, and fetch their records."""

from __future__ import annotations

from functools import partial

from fastapi import APIRouter, Response

from dohyo.service.accounts.access import Caller, Holder, Submitter
from dohyo.service.client.downloads import SIGNATURE_HEADER, signature_header
from dohyo.service.errors import ConflictError
from dohyo.service.simulating.order import WorldOrder, WorldRules
from dohyo.service.state import Services, ServicesOf
from dohyo.service.submissions.agent_routes import IdempotencyKey
from dohyo.service.web.bodies.strict_route import StrictRoute
from dohyo.service.web.caching import Cached
from dohyo.service.web.documents import After, Identifier, Limit, problems
from dohyo.service.web.files import OpenFileResponse
from dohyo.service.web.views import Page
from dohyo.service.worlds import queries
from dohyo.service.worlds.access import find_world, live_world, world_of
from dohyo.service.worlds.bodies import PaceRequest, ResetRequest, StepRequest, WorldRequest
from dohyo.service.worlds.orders import scenario_of
from dohyo.service.worlds.records import open_kept_trajectory, read_kept_record, records_folder, remove_record
from dohyo.service.worlds.views import WorldView, view_world
from dohyo.sumo_networks.scenario import content_hash

router = APIRouter(prefix="/v1", tags=["worlds"], route_class=StrictRoute)


@router.post("/worlds", status_code=201, responses=problems(403, 413, 507))
async def create_world(
    order: WorldRequest, caller: Submitter, services: ServicesOf, idempotency_key: IdempotencyKey = None
) -> WorldView:
    """Starts a world in a process of its own, and answers once its first tick is there.

    It waits until every ego has a driver, or until it is resumed. Each tick then waits for all who joined.
    """
    scenario = await services.orders.compute(partial(scenario_of, order), caller.owner, anonymous=False)
    folder = records_folder(services.settings).resolve() if order.record else None
    deadline_s = order.deadline_s or services.settings.act_deadline_s

    rules = WorldRules(deadline_s=deadline_s, late=order.late, pace=order.pace, speed=order.speed)

    def make(identifier: str) -> WorldOrder:
        kept = {"directory": folder, "stays": order.stays, "reward": order.reward}
        return WorldOrder(name=identifier, scenario=scenario, undriven=order.undriven, **kept)

    request = content_hash({"world": order.model_dump(mode="json")})
    identifier = await services.worlds.create(caller.owner, make, rules, (idempotency_key, request))
    return await _view(services, caller, identifier)


@router.get("/worlds", responses=problems())
def list_worlds(caller: Holder, services: ServicesOf, limit: Limit = 100, after: After = None) -> Page[WorldView]:
    """Lists your worlds; an administrator sees all."""
    with services.database.reading() as session:
        rows = queries.list_worlds(session, None if caller.is_admin else caller.owner, limit + 1, after)
    items = [view_world(row, services.worlds.find(row.id, heard=False)) for row in rows[:limit]]
    return Page(items=items, next=items[-1].id if len(rows) > limit else None)


@router.get("/worlds/{identifier}", responses=problems(404))
async def get_world(identifier: Identifier, caller: Holder, services: ServicesOf) -> WorldView:
    """One world."""
    return await _view(services, caller, identifier)


@router.post("/worlds/{identifier}/resume", responses=problems(403, 404, 409, 413))
async def resume_world(identifier: Identifier, caller: Submitter, services: ServicesOf) -> WorldView:
    """Lets a world tick, also before every ego has a driver."""
    (await live_world(services, caller, identifier)).lockstep.resume()
    return await _view(services, caller, identifier)


@router.post("/worlds/{identifier}/pause", responses=problems(403, 404, 409, 413))
async def pause_world(identifier: Identifier, caller: Submitter, services: ServicesOf) -> WorldView:
    """Lets a world stand still after its present tick. Nobody is late meanwhile."""
    (await live_world(services, caller, identifier)).lockstep.pause()
    return await _view(services, caller, identifier)


@router.post("/worlds/{identifier}/step", responses=problems(403, 404, 409, 413))
async def step_world(
    identifier: Identifier,
    order: StepRequest,
    caller: Submitter,
    services: ServicesOf,
    idempotency_key: IdempotencyKey = None,
) -> WorldView:
    """Lets a paused world go on for some ticks, each of which waits for all who joined.

    A request without an Idempotency-Key that is sent twice lets it go on twice as far; with one, only once.
    """
    (await live_world(services, caller, identifier)).lockstep.allow(order.ticks, idempotency_key)
    return await _view(services, caller, identifier)


@router.post("/worlds/{identifier}/pace", responses=problems(403, 404, 409, 413))
async def change_world_pace(
    identifier: Identifier, order: PaceRequest, caller: Submitter, services: ServicesOf
) -> WorldView:
    """Changes the pace of a world while it runs: lockstep, or the wall clock at any speed."""
    (await live_world(services, caller, identifier)).lockstep.change_pace(order.pace, order.speed)
    return await _view(services, caller, identifier)


@router.post("/worlds/{identifier}/reset", responses=problems(403, 404, 409, 413))
async def reset_world(
    identifier: Identifier, order: ResetRequest, caller: Submitter, services: ServicesOf
) -> WorldView:
    """Begins a world anew at tick 0, with a seed, the same drivers, and without actors of other simulators.

    All places see tick 0 next. The record is that of the last run.
    """
    await (await live_world(services, caller, identifier)).reset(order.seed)
    return await _view(services, caller, identifier)


@router.post("/worlds/{identifier}/end", responses=problems(403, 404, 409, 413))
async def end_world(identifier: Identifier, caller: Submitter, services: ServicesOf) -> WorldView:
    """Ends a world; its record says that its egos' drives were ended."""
    world = await live_world(services, caller, identifier)
    services.worlds.end_later(world, "its owner ended the world")
    await services.worlds.ended(identifier)
    return await _view(services, caller, identifier)


@router.delete("/worlds/{identifier}", status_code=204, responses=problems(403, 404, 409))
def delete_world(identifier: Identifier, caller: Submitter, services: ServicesOf) -> None:
    """Deletes a world that has ended, with its record."""
    with services.database.session() as session:
        row = world_of(session, caller, identifier, own=True)
        if row.status.live:
            raise ConflictError("expected a world that has ended, this one is live; end it first")
        queries.delete_world(session, row)
    remove_record(services.settings, identifier)


@router.get("/worlds/{identifier}/record", response_class=Response, responses=problems(404, 409, 410) | Cached.json())
def get_world_record(identifier: Identifier, caller: Holder, services: ServicesOf) -> Response:
    """The record of a world that has ended, as `dohyo score` reads it. Its benchmark is null: it enters no ranking.

    The header `dohyo-signature` has the service's signature of its hash: algorithm, public key, signature.
    """
    with services.database.reading() as session:
        row = world_of(session, caller, identifier)
    content = read_kept_record(services.settings, row)
    headers = {SIGNATURE_HEADER: signature_header(services.signing.sign(str(row.record_hash)))}
    return Response(content, media_type="application/json", headers=headers)


@router.get(
    "/worlds/{identifier}/trajectory",
    response_class=Response,
    responses=problems(404, 409, 410) | Cached.file("application/vnd.apache.parquet"),
)
def get_world_trajectory(identifier: Identifier, caller: Holder, services: ServicesOf) -> Response:
    """Trajectories of a world that has ended as Parquet, one row per object and tick."""
    with services.database.reading() as session:
        row = world_of(session, caller, identifier)
    file = open_kept_trajectory(services.settings, row)
    return OpenFileResponse(file, media_type="application/vnd.apache.parquet", filename=f"{identifier}.parquet")


async def _view(services: Services, caller: Caller, identifier: str) -> WorldView:
    row = await find_world(services, caller, identifier)  # first: a stranger's question is no request to the world
    return view_world(row, services.worlds.find(identifier))
