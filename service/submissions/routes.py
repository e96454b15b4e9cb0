"""Submissions: versions of an agent, of three kinds. Each is checked before it is stored."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Body, Path, Request
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from sqlalchemy.orm import Session

from dohyo.evaluation.agent import AgentSpec
from dohyo.evaluation.families import FORECASTING_CONTROL, PARKING_CONTROL, PLANNING_CONTROL, Family, family_for
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.accounts.access import Caller, Reader, Submitter
from dohyo.service.database.engine import serialise
from dohyo.service.database.idempotency import made_before, remember
from dohyo.service.errors import NotFoundError, TooManyRequestsError
from dohyo.service.forecasting.interface import check_forecaster
from dohyo.service.freeway.planner import check_planner
from dohyo.service.jobs.orders import Wait, answer_job, check_room, order_job, ordered
from dohyo.service.parking.interface import check_parker
from dohyo.service.state import Services, ServicesOf
from dohyo.service.storage import deletion
from dohyo.service.submissions import queries
from dohyo.service.submissions.agent_routes import IdempotencyKey, owned_agent, visible_agent
from dohyo.service.submissions.builtin_routes import check_builtin
from dohyo.service.submissions.kinds import BUILTIN, ONNX
from dohyo.service.submissions.model import Agent, AgentKind, Submission
from dohyo.service.submissions.views import SubmissionView, view_submission
from dohyo.service.web.bodies.strict_json import JsonError, parse_json
from dohyo.service.web.bodies.strict_route import StrictRoute
from dohyo.service.web.bodies.uploads import form_body, receive_upload
from dohyo.service.web.documents import Limit, Name, problems
from dohyo.service.web.spelling import SHA256
from dohyo.service.web.views import Page
from dohyo.sumo_networks.ego.control import CONTROLS
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.networks.parsing import file_hash
from dohyo.sumo_networks.scenario import content_hash
from dohyo.sumo_networks.sensors import Track, make_sensors

router = APIRouter(prefix="/v1/agents/{name}/submissions", tags=["agents"], route_class=StrictRoute)

PER_AGENT = 1000
SETTINGS_BYTES = 20_000
FORM = form_body(
    ["spec"],
    {
        "spec": {
            "type": "string",
            "description": "JSON: track, sensors, control, as `GET /v1/observations` describes them, and maybe a name.",
            "examples": ['{"track": "map", "sensors": ["speedometer", "route"], "control": "target_speed_steering"}'],
        }
    },
)

Settings = dict[str, Any]
TrackName = Literal["sensors", "map", "privileged"]
Text = Annotated[str, Field(min_length=1, max_length=100)]


class _Order(BaseModel):
    model_config = ConfigDict(extra="forbid")

    settings: Annotated[Settings, Field(description="Plain JSON.")] = {}

    @field_validator("settings")
    @classmethod
    def _is_short(cls, settings: Settings) -> Settings:
        if len(repr(settings)) > SETTINGS_BYTES:
            raise ValueError(f"expected at most {SETTINGS_BYTES} characters")
        return settings


class BuiltinOrder(_Order):
    """A built-in agent of this service with its settings."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={"examples": [{"kind": "builtin", "entry": "autopilot", "settings": {}}]},
    )

    kind: Literal["builtin"]
    entry: Annotated[Text, Field(description="A registered name, as `dohyo agents list` shows them.")]


class RemoteOrder(_Order):
    """An agent that drives through its own workers: its sensors and control."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {
                    "kind": "remote",
                    "track": "map",
                    "sensors": ["speedometer", "route"],
                    "control": "target_speed_steering",
                }
            ]
        },
    )

    kind: Literal["remote"]
    name: Annotated[Text | None, Field(description="As records call it; default: the agent's name.")] = None
    track: TrackName = "map"
    sensors: Annotated[list[Text], Field(min_length=1, max_length=50)] = ["speedometer", "route"]
    control: Text = "target_speed_steering"
    entry: Annotated[str | None, Field(min_length=1, max_length=200)] = None
    source_sha256: Annotated[str, Field(pattern=SHA256, description="Of the agent's program.")] = ""
    files_sha256: Annotated[str, Field(pattern=SHA256, description="Of the files that it reads, such as weights.")] = ""


SubmissionOrder = Annotated[BuiltinOrder | RemoteOrder, Body(discriminator="kind")]


@router.post("", status_code=201, response_model=SubmissionView, responses=ordered(SubmissionView, 404, 409, 413, 507))
async def create_submission(
    name: Name,
    order: SubmissionOrder,
    caller: Submitter,
    services: ServicesOf,
    wait_s: Wait,
    idempotency_key: IdempotencyKey = None,
) -> Any:
    """Submits a built-in agent with settings, which is tried in a job, or declares a remote one at once."""
    if isinstance(order, RemoteOrder):
        return await run_in_threadpool(_declare, services, caller, name, order, idempotency_key)
    await run_in_threadpool(_check_owner, services, caller, name)
    try:
        await run_in_threadpool(check_builtin, order.entry, order.settings)
    except UnknownNameError as error:
        raise InvalidInputError(str(error)) from error
    arguments = {"agent": name, "entry": order.entry, "settings": order.settings}
    job = await order_job(services, caller.owner, BUILTIN.name, arguments, key=idempotency_key)
    return await answer_job(services, job, wait_s)


@router.post(
    "/onnx",
    status_code=201,
    response_model=SubmissionView,
    responses=ordered(SubmissionView, 404, 409, 413, 507),
    openapi_extra=FORM,
)
async def create_onnx_submission(
    name: Name,
    request: Request,
    caller: Submitter,
    services: ServicesOf,
    wait_s: Wait,
    idempotency_key: IdempotencyKey = None,
) -> Any:
    """Submits an ONNX policy: a job checks it and tries it for two decisions.

    Later it drives without network, files or privileges.
    """
    await run_in_threadpool(_check_owner, services, caller, name)
    await run_in_threadpool(check_room, services, caller.owner)
    async with receive_upload(request, services.settings.upload_limit_bytes) as given:
        spec = _spec(given.fields.get("spec"), name)
        sha256 = await run_in_threadpool(file_hash, given.path)
        arguments = {"agent": name, "spec": spec.model_dump(mode="json"), "sha256": sha256}
        job = await order_job(services, caller.owner, ONNX.name, arguments, file=given.path, key=idempotency_key)
    return await answer_job(services, job, wait_s)


@router.get("", responses=problems(404))
def list_submissions(
    name: Name,
    caller: Reader,
    services: ServicesOf,
    limit: Limit = 100,
    after: Annotated[int | None, Field(ge=1, le=2**31 - 1)] = None,
) -> Page[SubmissionView]:
    """Lists an agent's submissions, the newest first."""
    with services.database.reading() as session:
        rows = queries.list_submissions(session, visible_agent(session, caller, name), limit + 1, after)
    items = [view_submission(submission, name) for submission in rows[:limit]]
    return Page(items=items, next=str(items[-1].version) if len(rows) > limit else None)


@router.delete("/{version}", status_code=204, responses=problems(403, 404, 409))
def delete_submission(
    name: Name, version: Annotated[int, Path(ge=1, le=2**31 - 1)], caller: Submitter, services: ServicesOf
) -> None:
    """Deletes a version that no evaluation names; its number is never given again."""
    with services.database.session() as session:
        submission = queries.find_submission(session, owned_agent(session, caller, name), version)
        if submission is None:
            raise NotFoundError(f"agent '{name}' has no version {version}")
        policy = deletion.delete_submission(session, submission)
    if policy is not None:
        deletion.remove_policy(services.settings, services.database, policy)


def _remote(order: RemoteOrder, agent: str) -> AgentInfo:
    try:
        _check_declared(order.track, order.sensors, order.control)
    except UnknownNameError as error:
        raise InvalidInputError(str(error)) from error
    name = order.name or agent
    return AgentInfo(
        name=name,
        kind="remote",
        entry=order.entry or f"remote:{name}",
        source_sha256=order.source_sha256,
        files_sha256=order.files_sha256,
        track=order.track,
        sensors=tuple(order.sensors),
        control=order.control,
        settings=order.settings,
    )


def _check_declared(track: TrackName, sensors: Sequence[str], control: str) -> None:
    """Checks sensors and control of a remote agent, by the kind of benchmark that it is for."""
    match family_for(control):
        case Family.FREEWAY:
            check_planner(track, sensors)
        case Family.PARKING:
            check_parker(track, sensors)
        case Family.FORECASTING:
            check_forecaster(track, sensors)
        case Family.DRIVING:
            make_sensors(sensors, Track[track.upper()])
            if control not in CONTROLS:
                others = (PARKING_CONTROL, PLANNING_CONTROL, FORECASTING_CONTROL)
                raise UnknownNameError("control", control, [*CONTROLS, *others])


def _spec(text: str | None, agent: str) -> AgentSpec:
    """The declaration of an agent in a form; without a name, the registered agent's name is used."""
    try:
        given = parse_json(text or "")
    except JsonError as error:
        raise InvalidInputError(f"spec: {error} (expected a JSON object with track, sensors, control)") from error
    if not isinstance(given, dict):
        raise InvalidInputError("spec: expected a JSON object (track, sensors, control)")
    try:
        order = RemoteOrder.model_validate({"kind": "remote", **given})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "spec"
        raise InvalidInputError(f"spec: {where}: {first['msg']}") from error
    name = order.name or agent
    return AgentSpec(name=name, track=order.track, sensors=tuple(order.sensors), control=order.control)


def _check_owner(services: Services, caller: Caller, name: str) -> None:
    """Checks the caller's permission before any costly work."""
    with services.database.reading() as session:
        _check_count(session, owned_agent(session, caller, name))


def _check_count(session: Session, agent: Agent) -> None:
    if queries.count_submissions(session, agent) >= PER_AGENT:
        raise TooManyRequestsError(f"at most {PER_AGENT} submissions of one agent", retry_s=3600)


def _declare(services: Services, caller: Caller, name: str, order: RemoteOrder, key: str | None) -> SubmissionView:
    """Stores a remote agent's declaration; there is nothing to try."""
    info, request = _remote(order, name), content_hash({"agent": name, "submission": order.model_dump()})
    with services.database.session() as session:
        serialise(session)
        agent = owned_agent(session, caller, name)
        before = made_before(session, caller.owner, key, request)
        if before and (made := session.get(Submission, before)):
            return view_submission(made, name)
        _check_count(session, agent)
        submission = queries.add_submission(session, agent, AgentKind.REMOTE, info)
        remember(session, caller.owner, key, request, submission.id)
        return view_submission(submission, name)
