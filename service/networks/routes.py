"""Networks: those that ship with dohyo, those that were uploaded, and their maps."""

from __future__ import annotations

import gzip
import math
from functools import lru_cache
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import Response

from dohyo.service.accounts.access import Reader, Submitter
from dohyo.service.confinement.limits import MEGABYTE
from dohyo.service.errors import ConflictError, TooManyRequestsError
from dohyo.service.networks.importing import import_confined
from dohyo.service.networks.map import Box, packed_map
from dohyo.service.networks.views import NetworkView
from dohyo.service.state import Services, ServicesOf
from dohyo.service.web.documents import Name, problems
from dohyo.service.web.uploads import Upload, form_body, receive_upload
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.entries import builtin_names, check_name, network_entry, network_names
from dohyo.sumo_networks.networks.importing import SUFFIXES
from dohyo.sumo_networks.networks.inspection import network_size
from dohyo.sumo_networks.networks.network import RoadNetwork

router = APIRouter(prefix="/v1/networks", tags=["networks"])

UPLOADED = 100
FORM = form_body(
    ["name"],
    {
        "name": {"type": "string", "pattern": "^[a-z0-9][a-z0-9-]{0,62}$", "examples": ["my-town"]},
        "lights": {"type": "string", "enum": ["true", "false"], "description": "Guess lights at large junctions."},
        "licence": {"type": "string", "maxLength": 200},
    },
)

Coordinate = Annotated[float | None, Query(description="Corner of the part to show, m; all four or none.")]


@router.get("", responses=problems())
def list_networks(caller: Reader) -> list[NetworkView]:
    """Lists the networks; one that became unreadable is left out."""
    views = []
    for name in network_names():
        try:
            views.append(_view(find_network(name)))
        except InvalidInputError:
            if name in builtin_names():
                raise
    return views


@router.get("/{name}", responses=problems(404))
def get_network(name: Name, caller: Reader) -> NetworkView:
    """One network."""
    return _view(find_network(name))


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
def get_network_map(
    name: Name,
    caller: Reader,
    x0: Coordinate = None,
    y0: Coordinate = None,
    x1: Coordinate = None,
    y1: Coordinate = None,
    accept_encoding: Annotated[str, Header(include_in_schema=False)] = "",
    if_none_match: Annotated[str, Header(include_in_schema=False)] = "",
) -> Response:
    """Roads of a network, or of a part of it, for a replay; metres in the network frame."""
    network, box = find_network(name), _box(x0, y0, x1, y1)
    etag = f'"{network.sha256[:32]}"'
    headers = {"etag": etag, "cache-control": "no-cache", "vary": "accept-encoding"}
    if etag in if_none_match.replace("W/", ""):
        return Response(status_code=304, headers=headers)
    packed = packed_map(name, network.sha256, box)
    if "gzip" in accept_encoding:
        return Response(packed, headers=headers | {"content-encoding": "gzip"}, media_type="application/json")
    return Response(gzip.decompress(packed), headers=headers, media_type="application/json")


@router.post("", status_code=201, responses=problems(403, 409, 413, 507), openapi_extra=FORM)
async def create_network(request: Request, caller: Submitter, services: ServicesOf) -> NetworkView:
    """Imports a SUMO net, an OpenStreetMap extract or an OpenDRIVE file; a failed import leaves nothing behind."""
    async with receive_upload(request, services.settings.upload_limit_bytes) as given:
        return await run_in_threadpool(_import, services, given)


def find_network(name: str) -> RoadNetwork:
    """A network of the catalog by its name; a name is never used as a path.

    Raises:
        UnknownNameError: There is none.
    """
    if name not in network_names():
        raise UnknownNameError("network", name, network_names())
    return load_network(name)


def _import(services: Services, given: Upload) -> NetworkView:
    name, lights = given.fields.get("name", ""), given.fields.get("lights", "false")
    licence = given.fields.get("licence") or None
    check_name(name)
    if name in network_names():
        raise ConflictError(f"network '{name}' exists, and networks never change; choose another name")
    if len(network_names()) - len(builtin_names()) >= UPLOADED:
        raise TooManyRequestsError(f"at most {UPLOADED} networks can be uploaded", retry_s=3600)
    if lights not in ("true", "false"):
        raise InvalidInputError("lights: expected true or false")
    if licence is not None and (len(licence) > 200 or not licence.isprintable()):
        raise InvalidInputError("licence: expected at most 200 printable characters")
    # Only the suffix of the sender's file name is used.
    suffix = next((end for end in (f"{one}{gz}" for one in SUFFIXES for gz in ("", ".gz")) if _ends(given, end)), None)
    if suffix is None:
        raise InvalidInputError(f"file: expected a name that ends in {', '.join(SUFFIXES)} (each also with .gz)")
    file = given.path.rename(given.path.with_name(f"{name}{suffix}"))
    limit_mb = services.settings.upload_limit_bytes * 4 / MEGABYTE
    import_confined(file, name, lights=lights == "true", limit_mb=limit_mb, licence=licence)
    return _view(find_network(name))


def _ends(given: Upload, suffix: str) -> bool:
    return given.name.lower().endswith(suffix)


def _box(*corners: float | None) -> Box | None:
    if all(corner is None for corner in corners):
        return None
    x0, y0, x1, y1 = (math.nan if corner is None else corner for corner in corners)
    if not (math.isfinite(x0 + y0 + x1 + y1) and x0 < x1 and y0 < y1):
        raise InvalidInputError("map: expected all of x0 < x1 and y0 < y1 in metres, or none of them")
    return x0, y0, x1, y1


def _view(network: RoadNetwork) -> NetworkView:
    return _viewed(network.name, network.sha256)


@lru_cache(maxsize=2 * UPLOADED)
def _viewed(name: str, sha256: str) -> NetworkView:
    network, entry = load_network(name), network_entry(name)
    return NetworkView(
        name=name,
        title=entry.title,
        licence=entry.licence,
        source=entry.source,
        origin="dohyo" if name in builtin_names() else "upload",
        sha256=sha256,
        **network_size(network).model_dump(),
        bounds=[round(value, 2) for value in network.bounds],
    )
