"""Episodes: attempts, record, trajectory, events, replay, explanation; and driving one again."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.service.accounts.access import Caller, Holder, Reader
from dohyo.service.client.downloads import SIGNATURE_HEADER, signature_header
from dohyo.service.episodes.explanations import explanation_at
from dohyo.service.episodes.kinds import REDRIVE, trace_path
from dohyo.service.episodes.readers import (
    Readers,
    ReadersOf,
    check_record,
    episode_for,
    is_day,
    is_lot,
    lot_of,
    open_trajectory,
    record_of,
    record_path,
    refuse_unrepeatable,
    trajectory_of,
    unreadable,
)
from dohyo.service.episodes.reading_views import (
    EpisodeDetail,
    EventsView,
    ExplanationView,
    VerificationView,
    WaitingView,
)
from dohyo.service.episodes.record_views import RecordView
from dohyo.service.episodes.replay import FORMAT, encode, infraction_document, replay_of
from dohyo.service.episodes.views import AttemptView, view_attempt, view_episode
from dohyo.service.errors import ConflictError, UnauthorisedError
from dohyo.service.evaluations import queries as evaluations
from dohyo.service.evaluations.access import Aspect, visible_among
from dohyo.service.evaluations.model import BenchmarkVersion, Episode, Evaluation
from dohyo.service.evaluations.views import view_egos
from dohyo.service.jobs.orders import Wait, answer_job, last_about, order_job, ordered
from dohyo.service.state import Services, ServicesOf
from dohyo.service.web.caching import Cached, Identified, already_has, immutable
from dohyo.service.web.documents import Limit, problems
from dohyo.service.web.files import OpenFileResponse
from dohyo.service.web.heavy import Heavy, heavy_read
from dohyo.service.web.views import Page
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network

RETRY_S = 2

router = APIRouter(prefix="/v1/episodes/{identifier}", tags=["episodes"], responses=problems(403, 404))


@router.get("")
def get_episode(identifier: Identified, caller: Reader, services: ServicesOf, readers: ReadersOf) -> EpisodeDetail:
    """Status and scores of an episode."""
    episode, evaluation, version = episode_for(services, caller, identifier, Aspect.RUN)
    with services.database.reading() as session:
        told = bool(visible_among(session, caller, (evaluation.id,), Aspect.RECORDS))
    benchmark = readers.stored(version)
    return EpisodeDetail(
        **view_episode(episode, told=told, hidden=evaluation.hidden_statuses(told)).model_dump(),
        agent=evaluation.submission.agent.name,
        agent_version=evaluation.submission.version,
        egos=view_egos(evaluation),
        benchmark=version.name,
        benchmark_version=version.sha256,
        rules=benchmark.rules if isinstance(benchmark, Benchmark) else None,
        network=readers.network_of(version, episode.cell) or None if told else None,
    )


@router.get("/attempts")
def list_attempts(
    identifier: Identified,
    caller: Reader,
    services: ServicesOf,
    limit: Limit = 100,
    after: Annotated[int, Query(ge=0, le=2**31 - 1, description="The `next` of the page before.")] = 0,
) -> Page[AttemptView]:
    """Lists all starts of an episode; none while its evaluation lasts and its status is hidden."""
    episode, evaluation, _ = episode_for(services, caller, identifier, Aspect.RUN)
    with services.database.reading() as session:
        told = bool(visible_among(session, caller, (evaluation.id,), Aspect.RECORDS))
        if episode.status in evaluation.hidden_statuses(told):
            return Page(items=[])
        rows = evaluations.list_attempts(session, episode.id, limit=limit + 1, after=after)
    items = [view_attempt(one, told=told) for one in rows[:limit]]
    return Page(items=items, next=str(items[-1].number) if len(rows) > limit else None)


@router.get("/record", responses=problems(403, 404, 409, 410) | Cached.json(RecordView))
@heavy_read
def get_episode_record(identifier: Identified, request: Request, caller: Reader, services: ServicesOf) -> Response:
    """The record of an episode, as `dohyo verify` and, of drives on roads, `dohyo score` read it; it never changes.

    The header `dohyo-signature` has the service's signature of its hash: algorithm, public key, signature.
    """
    episode, _, _ = episode_for(services, caller, identifier, Aspect.RECORDS)
    path = record_path(services.settings, episode)
    headers = immutable(f"{episode.record_hash}", services)
    headers[SIGNATURE_HEADER] = signature_header(services.signing.sign(path.stem))
    if already_has(request, headers):
        return Response(status_code=304, headers=headers)
    check_record(services.settings, episode)
    return Response(_read(path, episode), media_type="application/json", headers=headers)


@router.get("/trajectory", responses=problems(403, 404, 409, 410) | Cached.file("application/vnd.apache.parquet"))
@heavy_read
def get_episode_trajectory(identifier: Identified, request: Request, caller: Reader, services: ServicesOf) -> Response:
    """Trajectories of an episode as Parquet, one row per object and tick; byte ranges are supported."""
    episode, _, _ = episode_for(services, caller, identifier, Aspect.RECORDS)
    record_path(services.settings, episode)  # there must be one
    headers = immutable(f"{episode.record_hash}-trajectory", services)
    if already_has(request, headers):
        return Response(status_code=304, headers=headers)
    file = open_trajectory(services.settings, episode)
    name = f"{episode.scenario}-s{episode.seed}.parquet"
    return OpenFileResponse(file, headers=headers, media_type="application/vnd.apache.parquet", filename=name)


@router.get("/events", responses=problems(403, 404, 409, 410))
@heavy_read
def get_episode_events(identifier: Identified, caller: Reader, services: ServicesOf, readers: ReadersOf) -> EventsView:
    """The infractions in the order of time, each with its own cost."""
    episode, _, version = episode_for(services, caller, identifier, Aspect.REPLAYS)
    rules = readers.benchmark(version).rules
    egos: list[dict[str, Any]] = [
        {
            "name": ego.name,
            "status": ego.status.value,
            "failure": ego.failure,
            "contacts": ego.contacts,
            "infractions": [infraction_document(one, rules) for one in ego.infractions],
        }
        for ego in record_of(services.settings, episode).egos
    ]
    return EventsView(episode=episode.id, rules=rules, egos=egos)


@router.get("/replay", responses=problems(403, 404, 409, 410) | Cached.json())
async def get_episode_replay(
    identifier: Identified, request: Request, caller: Reader, services: ServicesOf, readers: ReadersOf, heavy: Heavy
) -> Response:
    """Data of a replay except the roads (`/v1/networks/{name}/map`): poses, lights, infractions, series.

    Of a parking lot (`kind: parking`): what stands there, and the motion of karts and pedestrians.
    """
    episode, _, version = await run_in_threadpool(episode_for, services, caller, identifier, Aspect.REPLAYS)
    path = record_path(services.settings, episode)
    headers = immutable(f"{episode.record_hash}-{episode.id}-replay{FORMAT}", services)
    headers |= {"vary": "Accept-Encoding", "content-encoding": "gzip"}
    if already_has(request, headers):
        return Response(status_code=304, headers=headers)
    kept = path.with_name(f"{path.stem}.replay-{FORMAT}-{episode.id}.json.gz")
    packed = "gzip" in request.headers.get("accept-encoding", "")

    def read() -> bytes:
        content = readers.derived(kept, lambda: _replay(services, readers, episode, version))
        return content if packed else gzip.decompress(content)

    content = await (run_in_threadpool(read) if kept.exists() else heavy(read))
    if not packed:
        del headers["content-encoding"]
    return Response(content, media_type="application/json", headers=headers)


@router.get(
    "/explanation",
    response_model=ExplanationView,
    responses=problems(403, 404, 409, 410)
    | {202: {"description": "A job finds them out; ask again after Retry-After seconds.", "model": WaitingView}},
)
async def get_episode_explanation(
    identifier: Identified,
    caller: Reader,
    services: ServicesOf,
    tick: Annotated[int, Query(ge=0, le=10_000_000, description="The decision taken when the world was at this tick.")],
    heavy: Heavy,
) -> Any:
    """Explanations of the agent's decisions.

    The first question of a caller with a token orders a job that drives the episode again, and answers 202 meanwhile.
    """
    episode, evaluation, _ = await run_in_threadpool(episode_for, services, caller, identifier, Aspect.REPLAYS)
    known = await heavy(lambda: _explanation(services, episode, evaluation, tick))
    if known is not None:
        return known
    job = await _explain(services, caller, episode)
    waiting = WaitingView(episode=episode.id, tick=tick, status="being found out", job=job)
    headers = {"location": f"/v1/jobs/{job}", "retry-after": str(RETRY_S)}
    return JSONResponse(waiting.model_dump(), 202, headers)


@router.post(
    "/verify", response_model=VerificationView, responses=ordered(VerificationView, 404, 409, 410, 413, made=200)
)
async def verify_episode(identifier: Identified, caller: Holder, services: ServicesOf, wait_s: Wait) -> Any:
    """Orders a job that drives the episode again and compares the hashes; it takes as long as the episode did."""
    episode, evaluation, _ = await run_in_threadpool(episode_for, services, caller, identifier, Aspect.RECORDS)
    await run_in_threadpool(_check_repeatable, services, episode, evaluation)
    return await answer_job(services, await _redrive(services, caller, episode), wait_s, made=200)


def _explanation(services: Services, episode: Episode, evaluation: Evaluation, tick: int) -> Response | None:
    """Answer with what is known; None while nothing is."""
    refuse_unrepeatable(evaluation)
    facts = record_of(services.settings, episode)
    trace = trace_path(record_path(services.settings, episode))
    if not trace.exists():
        return None
    try:
        found = explanation_at(trace, tick)
    except InvalidInputError as error:
        trace.unlink(missing_ok=True)
        raise unreadable(episode, error) from error
    view = ExplanationView(episode=episode.id, tick=tick, ticks=facts.ticks, explanations=found)
    return Response(view.model_dump_json(), media_type="application/json")


async def _explain(services: Services, caller: Caller, episode: Episode) -> str:
    """Job that finds out an episode's explanations.

    Raises:
        UnauthorisedError: The caller has no token, and driving costs minutes of a processor.
        ConflictError: An earlier job of the caller has found that there are none.
    """
    if caller.token_id is None:
        raise UnauthorisedError("the explanations are not known yet; a caller with a token may have them found out")
    last = await run_in_threadpool(last_about, services, caller.owner, REDRIVE.name, _subject(episode))
    if last is not None and last.failure is not None and last.failure.status == 409:
        raise ConflictError(last.failure.detail)
    if last is not None and last.answer is not None and not last.answer["same"]:
        raise ConflictError("driven again, the episode gave a different record: expected the same hash")
    return await _redrive(services, caller, episode)


async def _redrive(services: Services, caller: Caller, episode: Episode) -> str:
    arguments = {"episode": episode.id, "record": episode.record_hash}
    return await order_job(services, caller.owner, REDRIVE.name, arguments, subject=_subject(episode))


def _subject(episode: Episode) -> str:
    return f"record {episode.record_hash}"


def _check_repeatable(services: Services, episode: Episode, evaluation: Evaluation) -> None:
    refuse_unrepeatable(evaluation)
    if is_day(episode):
        raise ConflictError("a day of forecasts is judged again by `dohyo verify RECORD`, and not by the service")
    check_record(services.settings, episode)


def _replay(services: Services, readers: Readers, episode: Episode, version: BenchmarkVersion) -> bytes:
    if is_lot(episode):
        from dohyo.service.parking.replay import replay_of_lot  # loads numba

        return encode(replay_of_lot(*lot_of(services.settings, episode), episode=episode.id))
    facts, moves = record_of(services.settings, episode), trajectory_of(services.settings, episode)
    try:
        network = load_network(facts.scenario.network)
        document = replay_of(facts, moves, network, episode=episode.id, rules=readers.benchmark(version).rules)
    except InvalidInputError as error:
        raise ConflictError(f"episode '{episode.id}' cannot be drawn: {error}") from error
    return encode(document)


def _read(path: Path, episode: Episode) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise unreadable(episode, error) from error
