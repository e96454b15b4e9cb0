"""Networks: those that ship with dohyo, those that were uploaded, and their maps."""

from __future__ import annotations

import gzip
import math
from typing import Annotated, Any, Final

from fastapi import APIRouter, Header, Query, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import Response

from dohyo.service.accounts.access import Reader, Submitter
from dohyo.service.benchmarks.own import own_benchmarks
from dohyo.service.errors import ConflictError, ForbiddenError
from dohyo.service.jobs.orders import Wait, answer_job, check_room, order_job, ordered
from dohyo.service.networks.finding import check_known, find_network, view_network
from dohyo.service.networks.form import FORM, import_arguments
from dohyo.service.networks.kinds import IMPORT
from dohyo.service.networks.map import Box, packed_map
from dohyo.service.networks.model import UploadedNetwork
from dohyo.service.networks.views import NetworkView
from dohyo.service.state import ServicesOf
from dohyo.service.submissions.agent_routes import IdempotencyKey
from dohyo.service.web.bodies.uploads import receive_upload
from dohyo.service.web.documents import Name, problems
from dohyo.service.web.files import OpenFileResponse
from dohyo.service.web.heavy import Heavy
from dohyo.service.worlds.queries import list_live_worlds
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.networks.entries import builtin_names, network_names, network_path
from dohyo.sumo_networks.networks.importing import retract_network

router = APIRouter(prefix="/v1/networks", tags=["networks"])

PACKED: Final = "application/gzip"
PLAIN: Final = "application/xml"
BINARY: Final = {"schema": {"type": "string", "format": "binary"}}
Coordinate = Annotated[float | None, Query(description="Corner of the part to show, m; all four or none.")]


@router.get("", responses=problems())
def list_networks(caller: Reader) -> list[NetworkView]:
    """Lists the networks; one that became unreadable is left out."""
    views = []
    for name in network_names():
        try:
            views.append(view_network(name))
        except InvalidInputError:
            if name in builtin_names():
                raise
    return views


@router.get("/{name}", responses=problems(404))
def get_network(name: Name, caller: Reader) -> NetworkView:
    """One network."""
    return view_network(name)


@router.get(
    "/{name}/net",
    response_class=Response,
    responses=problems(404) | {200: {"description": "The net.", "content": {PACKED: BINARY, PLAIN: BINARY}}},
)
def get_net(name: Name, caller: Reader) -> Response:
    """The SUMO net, packed if the catalog has it so. `dohyo networks import` takes it without a change."""
    check_known(name)
    path = network_path(name)
    try:
        file = path.open("rb")
    except OSError as error:  # deleted since
        raise UnknownNameError("network", name, network_names()) from error
    return OpenFileResponse(file, media_type=PACKED if path.suffix == ".gz" else PLAIN, filename=path.name)


@router.get(
    "/{name}/map",
    response_class=Response,
    responses=problems(404)
    | {
        200: {
            "description": "Lanes, junctions and stop lines; a network never changes under its ETag.",
            "content": {"application/json": {"schema": {"type": "object"}}},
        },
        304: {"description": "As the caller has it."},
    },
)
async def get_network_map(
    name: Name,
    caller: Reader,
    heavy: Heavy,
    x0: Coordinate = None,
    y0: Coordinate = None,
    x1: Coordinate = None,
    y1: Coordinate = None,
    accept_encoding: Annotated[str, Header(include_in_schema=False)] = "",
    if_none_match: Annotated[str, Header(include_in_schema=False)] = "",
) -> Response:
    """Roads of a network, or of a part of it, for a replay; metres in the network frame."""
    box = _box(x0, y0, x1, y1)
    return await heavy(lambda: _map(name, box, accept_encoding, if_none_match))


def _map(name: str, box: Box | None, accept_encoding: str, if_none_match: str) -> Response:
    network = find_network(name)
    etag = f'"{network.sha256[:32]}"'
    headers = {"etag": etag, "cache-control": "no-cache", "vary": "accept-encoding"}
    if etag in if_none_match.replace("W/", ""):
        return Response(status_code=304, headers=headers)
    packed = packed_map(name, network.sha256, box)
    if "gzip" in accept_encoding:
        return Response(packed, headers=headers | {"content-encoding": "gzip"}, media_type="application/json")
    return Response(gzip.decompress(packed), headers=headers, media_type="application/json")


@router.post(
    "",
    status_code=201,
    response_model=NetworkView,
    responses=ordered(NetworkView, 409, 413, 507),
    openapi_extra=FORM,
)
async def create_network(
    request: Request, caller: Submitter, services: ServicesOf, wait_s: Wait, idempotency_key: IdempotencyKey = None
) -> Any:
    """Imports a SUMO net, an OpenStreetMap extract or an OpenDRIVE file in a job; a failed import leaves nothing.

    The sender's file name must end as such files do, packed ones too.
    """
    await run_in_threadpool(check_room, services, caller.owner)
    async with receive_upload(request, services.settings.upload_limit_bytes) as given:
        arguments = await run_in_threadpool(import_arguments, given)
        job = await order_job(services, caller.owner, IMPORT.name, arguments, file=given.path, key=idempotency_key)
    return await answer_job(services, job, wait_s)


@router.delete("/{name}", status_code=204, responses=problems(403, 404, 409))
def delete_network(name: Name, caller: Submitter, services: ServicesOf) -> None:
    """Deletes an uploaded network that no live world and no benchmark uses; its name is free again.

    Earlier records stay, without the roads that their replays need.
    """
    with services.database.session() as session:
        row = session.get(UploadedNetwork, name)
        if row is None:
            check_known(name)
        if row is None or not caller.owns(row.owner):
            raise ForbiddenError(f"network '{name}' is not yours")
        if used := [one.name for one in own_benchmarks() if name in one.networks]:
            raise ConflictError(f"benchmark '{used[0]}' of this service drives on network '{name}'")
        if there := [world.id for world in list_live_worlds(session) if world.network == name]:
            raise ConflictError(f"world '{there[0]}' drives on network '{name}'; end it first")
        session.delete(row)
        # Files first: a deletion that is cut off here can be sent again, where files without a row would stay.
        if name in network_names():
            retract_network(name)


def _box(*corners: float | None) -> Box | None:
    if all(corner is None for corner in corners):
        return None
    x0, y0, x1, y1 = (math.nan if corner is None else corner for corner in corners)
    if not (math.isfinite(x0 + y0 + x1 + y1) and x0 < x1 and y0 < y1):
        raise InvalidInputError("map: expected all of x0 < x1 and y0 < y1 in metres, or none of them")
    return x0, y0, x1, y1
