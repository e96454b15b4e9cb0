"""Places in worlds: join, decide, put actors, leave."""

from __future__ import annotations

import math
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request, Response

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.accounts.access import Submitter, WorkerCaller
from dohyo.service.errors import ServiceError
from dohyo.service.simulating.actors import ActorChange
from dohyo.service.state import ServicesOf
from dohyo.service.web.bodies.strict_route import StrictRoute
from dohyo.service.web.documents import Identifier, problems
from dohyo.service.wire import openapi as schema
from dohyo.service.wire.messages import decode_as
from dohyo.service.wire.requests import bearer_of, body_of, encoded, formats_of, headers_of, problem_of
from dohyo.service.worlds.access import live_world
from dohyo.service.worlds.admission import admit
from dohyo.service.worlds.bodies import JoinRequest, Seated, WorldReply, WorldStep
from dohyo.service.worlds.live.seat import Seat
from dohyo.service.worlds.live.world import LiveWorld
from dohyo.sumo_networks.ego.pose import WORLD_CONTROLS
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.sensors import Track, make_sensors
from dohyo.sumo_networks.units import TICK_S

MOST_SHOWN_BYTES = 8_000_000
"""What a place may observe in a tick; 40 cameras of 256 x 256 pixels."""

router = APIRouter(prefix="/v1", tags=["worlds"], route_class=StrictRoute)

MOST_BYTES = 1024 * 1024
"""Size of a body with actors: 2,000 take 0.4 MB of JSON."""
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
        "resets": 0,
        "observations": {"west-1": {"speedometer": [0.0]}},
    },
)
TRUCK = {"name": "truck-1", "kind": "truck", "x_m": 512.4, "y_m": 80.1, "heading_rad": 1.57}
STEP = schema.WORKER_TOKEN | schema.body(WorldStep, {"tick": 0, "resets": 0, "actions": {"west-1": [8.0, 0.0]}})
STEPPED = schema.answer(
    "The next observations.",
    WorldReply,
    {
        "tick": 1,
        "time_s": 0.1,
        "observations": {"west-1": {"speedometer": [0.2]}},
        "rewards": None,
        "done": False,
        "missed": 0,
        "clipped": 0,
        "directive": "run",
        "resets": 0,
    },
)


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
    after a crash. The messages of the old place are answered with 410. A worker of another owner sends the code of an
    invitation when it joins first.
    """
    if order.invitation is not None:
        await admit(services, caller, identifier, order.invitation)
    world = await live_world(services, caller, identifier, own=False)
    egos = tuple(dict.fromkeys(order.egos))
    if not caller.owns(world.owner):
        world.guests.check(caller.owner, egos, coupled=order.coupled)
    seat = Seat(_spec(order), egos, caller.owner, caller.token_id or "", order.coupled)
    await world.join(seat)
    services.worlds.add_seat(world, seat)
    reply, answered = world.steps.reply_to(seat), formats_of(headers_of(request.scope))[1]
    given = Seated(
        seat=seat.id,
        token=seat.token,
        world=world.id,
        dt_s=TICK_S,
        deadline_ms=round(world.lockstep.deadline_s * 1000),
        missions=_told(world, seat),
        seed=world.simulation.seed,
        tick=seat.tick,
        resets=seat.resets,
        observations=reply.observations,
        actors=reply.actors,
    )
    return Response(await encoded(given, answered, reply.observations), 201, media_type=answered)


@router.get(
    "/seats/{seat}",
    openapi_extra=schema.WORKER_TOKEN,
    responses={**problems(410), 200: STEPPED},
    response_class=Response,
)
async def get_seat(seat: SeatId, request: Request, services: ServicesOf) -> Response:
    """What a place observes now, such as after a reset of its world."""
    headers = headers_of(request.scope)
    try:
        world, place = services.worlds.seat_of(seat, bearer_of(headers))
        await world.simulation.wait()
        place.refuse_ended()
        reply = world.steps.reply_to(place)
    except (ServiceError, InvalidInputError) as error:
        return problem_of(error)
    answered = formats_of(headers)[1]
    return Response(await encoded(reply, answered, reply.observations), media_type=answered)


@router.post(
    "/seats/{seat}/step",
    openapi_extra=STEP,
    responses={**problems(409, 410, 413), 200: STEPPED},
    response_class=Response,
)
async def step_seat(seat: SeatId, request: Request, services: ServicesOf) -> Response:
    """Sends the actions of a place for one tick, and answers once all who joined have sent theirs.

    A place that is coupled also puts, moves and removes actors. A repeated tick gets the same answer. 503: the tick
    still waits; send the same again.
    """
    headers = headers_of(request.scope)
    try:
        world, place = services.worlds.seat_of(seat, bearer_of(headers))
        taken, answered = formats_of(headers)
        body = await body_of(headers, request.receive, MOST_BYTES)
        reply = await world.steps.take(place, decode_as(body, taken, WorldStep, "{tick, actions}"), taken)
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
    """Leaves a world; its egos have no driver from now on, and its actors are gone."""
    headers = headers_of(request.scope)
    try:
        world, place = services.worlds.seat_of(seat, bearer_of(headers))
        await body_of(headers, request.receive)
        world.leave(place, "its worker left")
    except (ServiceError, InvalidInputError) as error:
        return problem_of(error)
    return Response(status_code=204)


@router.post(
    "/worlds/{identifier}/actors",
    status_code=204,
    openapi_extra=schema.body(ActorChange, {"put": [TRUCK], "remove": []}),
    responses={**problems(403, 404, 409, 413), 204: {"description": "They are there at the next tick."}},
    response_class=Response,
)
async def change_actors(identifier: Identifier, request: Request, caller: Submitter, services: ServicesOf) -> Response:
    """Puts, moves and removes actors before the next tick: all of them or, where one cannot be, none.

    The traffic yields to them, sensors and criteria see them. They stay where they are until they are moved.
    """
    world = await live_world(services, caller, identifier)
    headers = headers_of(request.scope)
    taken = formats_of(headers)[0]
    body = await body_of(headers, request.receive, MOST_BYTES)
    world.put_actors(decode_as(body, taken, ActorChange, "{put, remove}"))
    return Response(status_code=204)


def _spec(order: JoinRequest) -> AgentSpec:
    """Sensors and control of a worker, checked.

    Raises:
        InvalidInputError: There is no such sensor on the track, or no such control; or a tick would show too much.
    """
    try:
        sensors = make_sensors(order.sensors, Track[order.track.upper()])
        if order.control not in WORLD_CONTROLS:
            raise UnknownNameError("control", order.control, WORLD_CONTROLS)
    except UnknownNameError as error:
        raise InvalidInputError(str(error)) from error
    one = sum(sensor.space.dtype.itemsize * math.prod(sensor.space.shape) for sensor in sensors)
    if (shown := one * max(1, len(set(order.egos)))) > MOST_SHOWN_BYTES:
        raise InvalidInputError(
            f"expected sensors whose arrays have at most {MOST_SHOWN_BYTES:,} bytes a tick, for all egos of the place, "
            f"got {shown:,}"
        )
    return AgentSpec(name=order.name, track=order.track, sensors=tuple(order.sensors), control=order.control)


def _told(world: LiveWorld, seat: Seat) -> list[Any]:
    """Missions of the egos of a seat; who made the world chose the scenario, so nothing is hidden."""
    missions = {mission.name: mission for mission in world.order.scenario.missions}
    return [missions[ego].model_dump(mode="json", include={"name", "start", "goal", "via"}) for ego in seat.egos]
