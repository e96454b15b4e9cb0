"""Worlds: start, join, step, pause and end live scenarios, and fetch their records."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, Path, Request, Response

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.accounts.access import Caller, Holder, Submitter, WorkerCaller
from dohyo.service.errors import ConflictError, ServiceError
from dohyo.service.state import Services, ServicesOf
from dohyo.service.web.caching import Cached
from dohyo.service.web.documents import After, Identifier, Limit, problems
from dohyo.service.web.files import OpenFileResponse
from dohyo.service.web.strict_json import StrictRoute
from dohyo.service.web.views import Page
from dohyo.service.wire import openapi as schema
from dohyo.service.wire.messages import decode_step
from dohyo.service.wire.requests import bearer_of, body_of, encoded, formats_of, headers_of, problem_of
from dohyo.service.worlds import queries
from dohyo.service.worlds.access import find_world, live_world, world_of
from dohyo.service.worlds.bodies import JoinRequest, Seated, StepRequest, WorldRequest
from dohyo.service.worlds.book import record_path, records_folder
from dohyo.service.worlds.model import World
from dohyo.service.worlds.order import WorldOrder
from dohyo.service.worlds.orders import scenario_of
from dohyo.service.worlds.seat import Seat
from dohyo.service.worlds.views import WorldView, view_world
from dohyo.service.worlds.world import LiveWorld
from dohyo.sumo_networks.ego.control import CONTROLS
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.sensors import Track, make_sensors
from dohyo.sumo_networks.units import TICK_S

router = APIRouter(prefix="/v1", tags=["worlds"], route_class=StrictRoute)

SeatId = Annotated[str, Path(max_length=40, examples=["s-3f9a1c0b7d2e4f5a6b7c8d9e"])]
SEATED = schema.answer(
    "A place in the world, with what its egos observe now.",
    Seated,
    {
        "seat": "s-3f9a1c0b7d2e4f5a6b7c8d9e",
        "token": "Zk3...",
        "world": "wo-9f86d081884c7d65",
        "dt_s": 0.1,
        "deadline_ms": 10000,
        "missions": [{"name": "west-1"}],
        "seed": 0,
        "tick": 0,
        "observations": {"west-1": {"speedometer": [0.0]}},
    },
)


@router.post("/worlds", status_code=201, responses=problems(403, 413, 507))
async def create_world(order: WorldRequest, caller: Submitter, services: ServicesOf) -> WorldView:
    """Starts a world in a process of its own, and answers once its first tick is there.

    It waits until every ego has a driver, or until it is resumed. Each tick then waits for all who joined.
    """
    scenario = await asyncio.to_thread(scenario_of, order)
    folder = records_folder(services.settings).resolve() if order.record else None
    deadline_s = order.deadline_s or services.settings.act_deadline_s

    def make(identifier: str) -> WorldOrder:
        return WorldOrder(name=identifier, scenario=scenario, undriven=order.undriven, directory=folder)

    identifier = await services.worlds.create(caller.owner, make, deadline_s, order.late)
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
    (await live_world(services, caller, identifier)).resume()
    return await _view(services, caller, identifier)


@router.post("/worlds/{identifier}/pause", responses=problems(403, 404, 409, 413))
async def pause_world(identifier: Identifier, caller: Submitter, services: ServicesOf) -> WorldView:
    """Lets a world stand still after its present tick. Nobody is late meanwhile."""
    (await live_world(services, caller, identifier)).pause()
    return await _view(services, caller, identifier)


@router.post("/worlds/{identifier}/step", responses=problems(403, 404, 409, 413))
async def step_world(identifier: Identifier, order: StepRequest, caller: Submitter, services: ServicesOf) -> WorldView:
    """Lets a paused world go on for some ticks, each of which waits for all who joined."""
    (await live_world(services, caller, identifier)).allow(order.ticks)
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
        row = world_of(session, caller, identifier)
        if row.status.live:
            raise ConflictError("expected a world that has ended, this one is live; end it first")
        session.delete(row)
    path = record_path(services.settings, identifier)
    path.unlink(missing_ok=True)
    path.with_suffix(".parquet").unlink(missing_ok=True)


@router.get("/worlds/{identifier}/record", response_class=Response, responses=problems(404, 409) | Cached.json())
def get_world_record(identifier: Identifier, caller: Holder, services: ServicesOf) -> Response:
    """The record of a world that has ended, as `dohyo score` reads it. Its benchmark is null: it enters no ranking."""
    with services.database.reading() as session:
        _recorded(world_of(session, caller, identifier))
    return Response(record_path(services.settings, identifier).read_bytes(), media_type="application/json")


@router.get(
    "/worlds/{identifier}/trajectory",
    response_class=Response,
    responses=problems(404, 409) | Cached.file("application/vnd.apache.parquet"),
)
def get_world_trajectory(identifier: Identifier, caller: Holder, services: ServicesOf) -> Response:
    """Trajectories of a world that has ended as Parquet, one row per object and tick."""
    with services.database.reading() as session:
        _recorded(world_of(session, caller, identifier))
    file = record_path(services.settings, identifier).with_suffix(".parquet").open("rb")
    return OpenFileResponse(file, media_type="application/vnd.apache.parquet", filename=f"{identifier}.parquet")


@router.post(
    "/worlds/{identifier}/join",
    status_code=201,
    response_class=Response,
    responses={**problems(403, 404, 409, 410, 413), 201: SEATED},
)
async def join_world(
    identifier: Identifier, order: JoinRequest, request: Request, caller: WorkerCaller, services: ServicesOf
) -> Response:
    """Takes a place in a world, at any time, with egos that nobody else drives.

    Who joins again by the same name with the same egos, sensors and control takes the place back where it was, such as
    after a crash. The messages of the old place are answered with 410.
    """
    world = await live_world(services, caller, identifier)
    seat = await world.join(_spec(order), tuple(dict.fromkeys(order.egos)), caller.token_id or "")
    services.worlds.add_seat(world, seat)
    answered = formats_of(headers_of(request.scope))[1]
    observations = msgspec.Raw(msgspec.msgpack.encode(world.observations_of(seat)))
    given = Seated(
        seat=seat.id,
        token=seat.token,
        world=world.id,
        dt_s=TICK_S,
        deadline_ms=round(world.deadline_s * 1000),
        missions=_told(world, seat),
        seed=world.order.scenario.seed,
        tick=seat.tick,
        observations=observations,
    )
    return Response(await encoded(given, answered, observations), 201, media_type=answered)


@router.post(
    "/seats/{seat}/step",
    openapi_extra=schema.STEP,
    responses={**problems(409, 410, 413), 200: schema.STEPPED},
    response_class=Response,
)
async def step_seat(seat: SeatId, request: Request, services: ServicesOf) -> Response:
    """Sends the actions of a place for one tick, and answers once all who joined have sent theirs.

    A repeated tick gets the same answer. 503: the tick still waits; send the same again.
    """
    headers = headers_of(request.scope)
    try:
        world, place = services.worlds.seat_of(seat, bearer_of(headers))
        taken, answered = formats_of(headers)
        body = await body_of(headers, request.receive)
        reply = await world.step(place, decode_step(body, taken), taken)
    except (ServiceError, InvalidInputError) as error:
        return problem_of(error)
    return Response(await encoded(reply, answered, reply.observations), media_type=answered)


@router.post(
    "/seats/{seat}/leave",
    status_code=204,
    openapi_extra=schema.WORKER_TOKEN,
    responses={**problems(410, 413), 204: {"description": "Left."}},
    response_class=Response,
)
async def leave_seat(seat: SeatId, request: Request, services: ServicesOf) -> Response:
    """Leaves a world; its egos have no driver from now on."""
    headers = headers_of(request.scope)
    try:
        world, place = services.worlds.seat_of(seat, bearer_of(headers))
        await body_of(headers, request.receive)
        world.leave(place, "its worker left")
    except (ServiceError, InvalidInputError) as error:
        return problem_of(error)
    return Response(status_code=204)


def _spec(order: JoinRequest) -> AgentSpec:
    """Sensors and control of a worker, checked.

    Raises:
        InvalidInputError: There is no such sensor on the track, or no such control.
    """
    try:
        make_sensors(order.sensors, Track[order.track.upper()])
        if order.control not in CONTROLS:
            raise UnknownNameError("control", order.control, CONTROLS)
    except UnknownNameError as error:
        raise InvalidInputError(str(error)) from error
    return AgentSpec(name=order.name, track=order.track, sensors=tuple(order.sensors), control=order.control)


def _told(world: LiveWorld, seat: Seat) -> list[Any]:
    """Missions of the egos of a seat; who made the world chose the scenario, so nothing is hidden."""
    missions = {mission.name: mission for mission in world.order.scenario.missions}
    return [missions[ego].model_dump(mode="json", include={"name", "start", "goal", "via"}) for ego in seat.egos]


def _recorded(row: World) -> None:
    if row.record_hash is None:
        raise ConflictError("the world is live, or was not recorded to its end")


async def _view(services: Services, caller: Caller, identifier: str) -> WorldView:
    live = services.worlds.find(identifier)
    return view_world(await find_world(services, caller, identifier), live)
