"""Spectating: a live world as server-sent events, and the replay of one that has ended."""

from __future__ import annotations

import gzip
from functools import partial
from pathlib import Path
from typing import Final

from fastapi import APIRouter, Request, Response
from starlette.concurrency import run_in_threadpool

from dohyo.evaluation.records.store import read_record, read_trajectory
from dohyo.evaluation.scores.driving import Rules
from dohyo.service.accounts.access import Holder
from dohyo.service.episodes.readers import ReadersOf
from dohyo.service.episodes.replay import FORMAT, encode, replay_of
from dohyo.service.errors import ConflictError, GoneError
from dohyo.service.spectating.audience import Spectator
from dohyo.service.state import ServicesOf
from dohyo.service.web.caching import Cached, already_has, immutable
from dohyo.service.web.documents import Identifier, problems
from dohyo.service.web.events import MEDIA_TYPE, EventResponse
from dohyo.service.web.heavy import Heavy
from dohyo.service.worlds.access import find_world, is_admitted
from dohyo.service.worlds.records import kept_record
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network

RULES: Final[Rules] = "2.0"

router = APIRouter(prefix="/v1/worlds/{identifier}", tags=["worlds"])


@router.get(
    "/events",
    response_class=Response,
    responses=problems(404, 409)
    | {200: {"description": "Events `stage`, `state`, `plans`, `scene`, `end`.", "content": {MEDIA_TYPE: {}}}},
)
async def stream_world(identifier: Identifier, request: Request, caller: Holder, services: ServicesOf) -> Response:
    """Streams a live world to a spectator as server-sent events, at most ten scenes a second.

    `stage` has what does not change, `state` the status and the drivers after each change, `plans` what drivers intend,
    `scene` what is seen, and `end` the status at the end. A spectator that reads slowly misses scenes, and the world
    never waits for it.
    """
    await find_world(services, caller, identifier)
    world = services.worlds.find(identifier, heard=False)
    if world is None:
        raise ConflictError(f"world '{identifier}' has ended")
    world.audience.check_room()
    spectator = Spectator(caller.token_id or "", caller.owner)
    return EventResponse(request, world.audience.events(spectator, partial(is_admitted, caller, world)))


@router.get("/replay", response_class=Response, responses=problems(404, 409, 410) | Cached.json())
async def get_world_replay(
    identifier: Identifier, request: Request, caller: Holder, services: ServicesOf, readers: ReadersOf, heavy: Heavy
) -> Response:
    """Data of the replay of a world that has ended, as that of an episode."""
    row = await find_world(services, caller, identifier)
    path = kept_record(services.settings, row)
    headers = immutable(f"{row.record_hash}-{identifier}-replay{FORMAT}", services)
    headers |= {"cache-control": "private", "vary": "Accept-Encoding", "content-encoding": "gzip"}
    if already_has(request, headers):
        return Response(status_code=304, headers=headers)
    kept = path.with_name(f"{identifier}.replay-{FORMAT}.json.gz")
    packed = "gzip" in request.headers.get("accept-encoding", "")

    def read() -> bytes:
        content = readers.derived(kept, lambda: _replay(path, identifier))
        return content if packed else gzip.decompress(content)

    content = await (run_in_threadpool(read) if kept.exists() else heavy(read))
    if not packed:
        del headers["content-encoding"]
    return Response(content, media_type="application/json", headers=headers)


def _replay(path: Path, identifier: str) -> bytes:
    try:
        record, trajectory = read_record(path), read_trajectory(path)
    except InvalidInputError as error:
        raise GoneError(f"the record of world '{identifier}' is missing or damaged on the server") from error
    try:
        network = load_network(record.scenario.network)
        return encode(replay_of(record, trajectory, network, episode=identifier, rules=RULES))
    except InvalidInputError as error:
        raise ConflictError(f"world '{identifier}' cannot be drawn: {error}") from error
