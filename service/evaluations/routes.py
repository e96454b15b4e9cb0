"""Evaluations: created, listed, watched, cancelled, resumed."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence, Set
from dataclasses import dataclass
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from sqlalchemy.orm import Session

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.freeway.benchmark import ForecastBenchmark
from dohyo.evaluation.freeway.day import DaysManifest
from dohyo.evaluation.freeway.morning import MorningsManifest
from dohyo.evaluation.parking.benchmark import ParkingBenchmark
from dohyo.evaluation.parking.lot_files import LotsManifest
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.running.manifest import Manifest, manifest_of
from dohyo.service.accounts.access import Caller, Reader, Submitter
from dohyo.service.benchmarks.catalog import AnyBenchmark, check_agent, find_benchmark, read_benchmark
from dohyo.service.boards.model import Ranking
from dohyo.service.boards.rankings import check_entry, open_ranking
from dohyo.service.challenges.queries import find_phase
from dohyo.service.database.engine import serialise
from dohyo.service.database.idempotency import made_before, remember
from dohyo.service.episodes.views import EpisodeView, view_episode
from dohyo.service.errors import BusyError, ConflictError, ForbiddenError, NotFoundError, TooManyRequestsError
from dohyo.service.evaluations import queries as evaluations
from dohyo.service.evaluations.access import Aspect, find_visible, require, seen_by, visible_among
from dohyo.service.evaluations.model import BenchmarkVersion, EpisodeStatus, Evaluation, EvaluationStatus
from dohyo.service.evaluations.orders import EvaluationOrder, check_slow_policy, others_of
from dohyo.service.evaluations.views import EvaluationView, view_evaluation
from dohyo.service.state import Services, ServicesOf
from dohyo.service.storage import deletion
from dohyo.service.storage.usage import check_bytes
from dohyo.service.submissions.agent_routes import IdempotencyKey, owned_agent
from dohyo.service.submissions.installed import check_installed
from dohyo.service.submissions.model import Submission
from dohyo.service.submissions.queries import find_submission
from dohyo.service.web.bodies.strict_route import StrictRoute
from dohyo.service.web.documents import After, Identifier, Limit, problems
from dohyo.service.web.events import MEDIA_TYPE, EventResponse, stream
from dohyo.service.web.views import Page
from dohyo.sumo_networks.scenario import content_hash

router = APIRouter(prefix="/v1/evaluations", tags=["evaluations"], route_class=StrictRoute)


@router.post("", status_code=201, responses=problems(403, 404, 409, 413, 507))
async def create_evaluation(
    order: EvaluationOrder, caller: Submitter, services: ServicesOf, idempotency_key: IdempotencyKey = None
) -> EvaluationView:
    """Queues one agent on one benchmark; 429 past a quota, 503 where the queue is full.

    409 where a phase is closed, or where the code of a built-in agent has changed since it was submitted.
    """
    _refuse_while_ending(services)
    # One order of an owner at a time, or an owner with many would have every thread and the database's lock.
    planned = partial(_create, order, caller, services, idempotency_key)
    view = await services.orders.compute(planned, caller.owner, anonymous=False)
    services.scheduler.wake()
    services.events.publish("evaluations", {"evaluation": view.id, "status": view.status})
    return view


@router.get("", responses=problems())
def list_evaluations(
    caller: Reader,
    services: ServicesOf,
    agent: Annotated[str | None, Query(max_length=100)] = None,
    benchmark: Annotated[str | None, Query(max_length=100)] = None,
    status: EvaluationStatus | None = None,
    ranking: Annotated[str | None, Query(max_length=40, description="Only runs of this ranking.")] = None,
    limit: Limit = 50,
    after: After = None,
) -> Page[EvaluationView]:
    """Lists evaluations, the newest first."""
    with services.database.reading() as session:
        rows = evaluations.list_evaluations(
            session,
            seen_by(caller),
            ranking=ranking,
            agent=agent,
            benchmark=benchmark,
            status=status,
            limit=limit + 1,
            after=after,
        )
        items = _views(session, caller, rows[:limit])
    return Page(items=items, next=items[-1].id if len(rows) > limit else None)


@router.get("/{identifier}", responses=problems(404))
def get_evaluation(identifier: Identifier, caller: Reader, services: ServicesOf) -> EvaluationView:
    """Status of an evaluation."""
    return _state(services, caller, identifier)


@router.get(
    "/{identifier}/progress",
    response_class=Response,
    responses=problems(404)
    | {
        200: {"description": "Events `state`, `episode`, `end`.", "content": {MEDIA_TYPE: {}}},
        204: {"description": "There is nothing more to tell."},
    },
)
async def stream_evaluation_progress(
    identifier: Identifier,
    request: Request,
    caller: Reader,
    services: ServicesOf,
    last_event_id: Annotated[str, Header(include_in_schema=False)] = "",
) -> Response:
    """Streams the progress of an evaluation as server-sent events.

    The first event is always `state`, the whole evaluation, so that a client that reconnects misses nothing; then one
    `episode` event for each episode that starts or ends, and finally `end`, the whole evaluation again. Where the
    records are withheld, `state` stands in place of `episode`.
    """
    state = await run_in_threadpool(_state, services, caller, identifier)
    if last_event_id == "end" and state.status.finished:
        return Response(status_code=204)

    async def read() -> EvaluationView:
        return await run_in_threadpool(_state, services, caller, identifier)

    told = not state.withheld
    events: AsyncIterator[str] = stream(services.events, f"evaluation:{identifier}", read, name_episodes=told)
    return EventResponse(request, events)


@router.get("/{identifier}/manifest", responses=problems(403, 404))
def get_evaluation_manifest(
    identifier: Identifier, caller: Reader, services: ServicesOf
) -> Manifest | MorningsManifest | LotsManifest | DaysManifest:
    """Manifest of an evaluation with the whole benchmark; with the records it makes a result folder."""
    with services.database.reading() as session:
        evaluation = find_visible(session, caller, identifier)
        require(session, caller, evaluation, Aspect.RECORDS)
        benchmark, sha256 = read_benchmark(evaluation.benchmark.document), evaluation.benchmark_sha256
        seeds = evaluation.seeds
        agent = AgentInfo.model_validate(evaluation.submission.info)
        others = {one.ego: AgentInfo.model_validate(one.submission.info) for one in evaluation.egos}
    if isinstance(benchmark, Benchmark):
        names = [mission.name for cell in benchmark.cells for mission in benchmark.missions[cell.missions]]
        return manifest_of({name: others.get(name, agent) for name in names}, benchmark, sha256, seeds=seeds)
    if isinstance(benchmark, ParkingBenchmark):
        return LotsManifest(agent=agent, benchmark=benchmark, benchmark_sha256=sha256, seeds=tuple(seeds))
    if isinstance(benchmark, ForecastBenchmark):
        return DaysManifest(agent=agent, benchmark=benchmark, benchmark_sha256=sha256)
    return MorningsManifest(agent=agent, benchmark=benchmark, benchmark_sha256=sha256)


@router.get("/{identifier}/episodes", responses=problems(404))
def list_episodes(
    identifier: Identifier,
    caller: Reader,
    services: ServicesOf,
    status: EpisodeStatus | None = None,
    limit: Limit = 100,
    after: Annotated[int | None, Query(ge=0, le=2**31 - 1, description="The `next` of the page before.")] = None,
) -> Page[EpisodeView]:
    """Lists an evaluation's episodes in the benchmark's order, without scenarios and scores where withheld."""
    with services.database.reading() as session:
        evaluation = find_visible(session, caller, identifier)
        told = bool(visible_among(session, caller, (evaluation.id,), Aspect.RECORDS))
        hidden = evaluation.hidden_statuses(told)
        statuses = _stored_as(status, hidden)
        rows = evaluations.list_episodes(session, evaluation.id, statuses=statuses, limit=limit + 1, after=after)
    items = [view_episode(episode, told=told, hidden=hidden) for episode in rows[:limit]]
    return Page(items=items, next=str(items[-1].position) if len(rows) > limit else None)


def _stored_as(status: EpisodeStatus | None, hidden: Set[EpisodeStatus]) -> Sequence[EpisodeStatus]:
    """Stored statuses of the episodes that are shown with a status; see `view_episode`."""
    if status is None:
        return tuple(EpisodeStatus)
    if status is EpisodeStatus.QUEUED:
        return tuple(hidden | {status})
    return () if status in hidden else (status,)


@router.post("/{identifier}/cancel", responses=problems(403, 404, 409, 507))
async def cancel_evaluation(identifier: Identifier, caller: Submitter, services: ServicesOf) -> EvaluationView:
    """Cancels an evaluation at once; finished episodes are kept. Has no effect on a cancelled evaluation."""

    def check() -> EvaluationStatus:
        with services.database.reading() as session:
            return _owned(session, caller, identifier).status

    status = await run_in_threadpool(check)
    if status in (EvaluationStatus.DONE, EvaluationStatus.FAILED):
        raise ConflictError(f"evaluation '{identifier}' has ended: {status}")
    if status is not EvaluationStatus.CANCELLED:
        await services.scheduler.cancel(identifier)
    return await run_in_threadpool(_state, services, caller, identifier)


@router.delete("/{identifier}", status_code=204, responses=problems(403, 404, 409))
def delete_evaluation(identifier: Identifier, caller: Submitter, services: ServicesOf) -> None:
    """Deletes a practice run that has ended, with its episodes and records; ranked runs stay."""
    with services.database.session() as session:
        serialise(session)
        hashes = deletion.delete_evaluation(session, _owned(session, caller, identifier))
    deletion.remove_records(services.settings, services.database, hashes)


@router.post("/{identifier}/resume", responses=problems(403, 404, 409, 507))
async def resume_evaluation(identifier: Identifier, caller: Submitter, services: ServicesOf) -> EvaluationView:
    """Queues lost and cancelled episodes again; finished ones are kept. Has no effect where none is missing.

    409 where the code of a built-in agent has changed since it was submitted.
    """
    _refuse_while_ending(services)

    def again() -> None:
        check_installed(_drivers(services, caller, identifier))
        with services.database.session() as session:
            serialise(session)
            evaluation = _owned(session, caller, identifier)
            if not evaluation.status.finished or evaluation.status is EvaluationStatus.DONE:
                return
            if evaluation.ranking is not None and evaluation.ranking.ended():
                raise ConflictError(f"evaluation '{identifier}' is of a ranking that has ended; its board is final")
            _check_room(session, services, evaluation.owner, evaluations.count_missing(session, evaluation))
            if not evaluations.resume(session, evaluation):
                raise ConflictError(f"evaluation '{identifier}' has no episode that was lost or cancelled")

    await run_in_threadpool(again)
    services.scheduler.wake()
    return await run_in_threadpool(_state, services, caller, identifier)


@dataclass(frozen=True, slots=True)
class _Plan:
    """A run before it is queued.

    Attributes:
        benchmark: To drive.
        seeds: To drive it with.
        slow_policy: "wait" or "realtime".
        act_deadline_s: Wall-clock time for one decision.
        ranking_id: Ranking that the run enters; None in practice.
    """

    benchmark: AnyBenchmark
    seeds: list[int]
    slow_policy: str
    act_deadline_s: float
    ranking_id: str | None = None


def _create(order: EvaluationOrder, caller: Caller, services: Services, key: str | None) -> EvaluationView:
    request = content_hash({"evaluation": order.model_dump(mode="json")})
    if known := _made_before(services, caller, key, request):
        return known
    with services.database.reading() as session:
        submission = _submission(session, caller, order)
    # Planning routes is slow the first time, so it happens outside of any transaction; only what has room is planned.
    plan = _ranked_plan(order, submission, services) if order.ranked else _practice_plan(order, services)
    check_agent(submission.info, plan.benchmark)
    with services.database.reading() as session:
        others = others_of(session, caller, order, submission, plan.benchmark)
        _check_room(session, services, caller.owner, plan.benchmark.size * len(plan.seeds))
    check_installed([submission, *others.values()])
    scenarios = plan.benchmark.scenarios(plan.seeds)
    _refuse_while_ending(services)  # the client may have disconnected
    with services.database.session() as session:
        serialise(session)
        if known := _known(session, caller, key, request):
            return known
        _check_room(session, services, caller.owner, len(scenarios))
        team = None
        if plan.ranking_id is not None:
            team = check_entry(session, session.get_one(Ranking, plan.ranking_id), submission)
        evaluation = evaluations.add_evaluation(
            session,
            caller.owner,
            submission,
            plan.benchmark,
            plan.seeds,
            scenarios,
            slow_policy=plan.slow_policy,
            act_deadline_s=plan.act_deadline_s,
            ranking_id=plan.ranking_id,
            team_id=team,
            others=others,
        )
        remember(session, caller.owner, key, request, evaluation.id)
        return _views(session, caller, [evaluation])[0]


def _made_before(services: Services, caller: Caller, key: str | None, request: str) -> EvaluationView | None:
    with services.database.session() as session:
        return _known(session, caller, key, request)


def _known(session: Session, caller: Caller, key: str | None, request: str) -> EvaluationView | None:
    """The evaluation that the same order has made, unless it was deleted since."""
    before = made_before(session, caller.owner, key, request)
    made = session.get(Evaluation, before) if before else None
    return _views(session, caller, [made])[0] if made else None


def _practice_plan(order: EvaluationOrder, services: Services) -> _Plan:
    benchmark = find_benchmark(order.benchmark)
    check_slow_policy(order.slow_policy, benchmark)
    seeds = list(dict.fromkeys(order.seeds or benchmark.seeds))
    deadline_s = order.act_deadline_s or services.settings.act_deadline_s
    return _Plan(benchmark, seeds, order.slow_policy or "wait", deadline_s)


def _ranked_plan(order: EvaluationOrder, submission: Submission, services: Services) -> _Plan:
    """The plan of a ranked run, after a first check of its entry, so that no refused order costs the planning."""
    with services.database.session() as session:
        serialise(session)
        if order.ranking is None:
            ranking = open_ranking(session, find_benchmark(order.benchmark), services.settings)
        else:
            ranking = find_phase(session, order.ranking, order.benchmark)
        check_entry(session, ranking, submission)
        document = session.get_one(BenchmarkVersion, ranking.benchmark_sha256).document
    benchmark = read_benchmark(document)
    return _Plan(benchmark, ranking.seeds, ranking.slow_policy, ranking.act_deadline_s, ranking.id)


def _refuse_while_ending(services: Services) -> None:
    if services.draining:
        raise BusyError("the service is shutting down", retry_s=30)


def _submission(session: Session, caller: Caller, order: EvaluationOrder) -> Submission:
    agent = owned_agent(session, caller, order.agent)
    submission = find_submission(session, agent, order.version)
    if submission is None:
        wanted = "submission" if order.version is None else f"version {order.version}"
        raise NotFoundError(f"agent '{order.agent}' has no {wanted}")
    return submission


def _check_room(session: Session, services: Services, owner: str, episodes_more: int) -> None:
    """Refuses an order beyond the owner's quota or the limit of the queue."""
    settings = services.settings
    if evaluations.count_unfinished(session, owner) >= settings.evaluations_per_owner:
        raise TooManyRequestsError(
            f"you have {settings.evaluations_per_owner} unfinished evaluations, the most there may be", retry_s=60
        )
    check_bytes(session, owner, settings.bytes_per_owner)
    if evaluations.count_waiting(session, owner) + episodes_more > settings.queued_per_owner:
        raise TooManyRequestsError(
            f"the queue holds at most {settings.queued_per_owner} episodes of one owner; this order has"
            f" {episodes_more}",
            retry_s=60,
        )
    if evaluations.count_waiting(session) + episodes_more > settings.queue_limit:
        raise BusyError(f"the queue holds at most {settings.queue_limit} episodes, and has no room", retry_s=60)


def _owned(session: Session, caller: Caller, identifier: str) -> Evaluation:
    evaluation = find_visible(session, caller, identifier)
    if not caller.owns(evaluation.owner):
        raise ForbiddenError(f"evaluation '{identifier}' is another owner's")
    return evaluation


def _drivers(services: Services, caller: Caller, identifier: str) -> list[Submission]:
    """Submissions that drive in an evaluation if it is resumed."""
    with services.database.reading() as session:
        evaluation = _owned(session, caller, identifier)
        if not evaluation.status.finished or evaluation.status is EvaluationStatus.DONE:
            return []
        return [evaluation.submission, *(one.submission for one in evaluation.egos)]


def _state(services: Services, caller: Caller, identifier: str) -> EvaluationView:
    with services.database.reading() as session:
        return _views(session, caller, [find_visible(session, caller, identifier)])[0]


def _views(session: Session, caller: Caller, rows: Sequence[Evaluation]) -> list[EvaluationView]:
    ids = [one.id for one in rows]
    names, counts = evaluations.names_of(session, rows), evaluations.count_episodes(session, ids)
    told = visible_among(session, caller, ids, Aspect.RECORDS)
    return [view_evaluation(one, *names[one.id], counts[one.id], told=one.id in told) for one in rows]
