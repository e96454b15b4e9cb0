"""Submissions: versions of an agent, of three kinds. Each is checked before it is stored."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Body, Request
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from sqlalchemy.orm import Session

from dohyo.agents.registry import agent_entries
from dohyo.evaluation.agent import AgentSpec, agent_info
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.accounts.access import Caller, Reader, Submitter
from dohyo.service.confinement.limits import Limits
from dohyo.service.confinement.runner import run
from dohyo.service.database.idempotency import made_before, remember
from dohyo.service.errors import TooManyRequestsError
from dohyo.service.policies.agent import ENTRY, OnnxPolicy
from dohyo.service.policies.limits import MEGABYTE, PolicyLimits
from dohyo.service.state import Services, ServicesOf
from dohyo.service.submissions import queries
from dohyo.service.submissions.agent_routes import IdempotencyKey, owned_agent, visible_agent
from dohyo.service.submissions.builtin_routes import check_builtin
from dohyo.service.submissions.model import AgentKind, Submission
from dohyo.service.submissions.views import SubmissionView, view_submission
from dohyo.service.web.documents import Limit, Name, problems
from dohyo.service.web.strict_json import JsonError, StrictRoute, parse_json
from dohyo.service.web.uploads import Upload, form_body, receive_upload
from dohyo.service.web.views import Page
from dohyo.sumo_networks.ego.control import CONTROLS
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.scenario import content_hash
from dohyo.sumo_networks.sensors import Track, make_sensors

router = APIRouter(prefix="/v1/agents/{name}/submissions", tags=["agents"], route_class=StrictRoute)

PER_AGENT = 1000
TRIAL = Limits(wall_s=60.0, cpu_s=60, memory_mb=3000, file_mb=1, folder_mb=10)
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
    source_sha256: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$", description="Of the agent's program.")] = ""
    files_sha256: Annotated[
        str, Field(pattern=r"^([0-9a-f]{64})?$", description="Of the files that it reads, such as weights.")
    ] = ""


SubmissionOrder = Annotated[BuiltinOrder | RemoteOrder, Body(discriminator="kind")]


@router.post("", status_code=201, responses=problems(403, 404, 409, 413, 507))
def create_submission(
    name: Name, order: SubmissionOrder, caller: Submitter, services: ServicesOf, idempotency_key: IdempotencyKey = None
) -> SubmissionView:
    """Submits a built-in agent with settings, or declares a remote one."""
    _check_owner(services, caller, name)
    info = _builtin(order) if isinstance(order, BuiltinOrder) else _remote(order, name)
    request = content_hash({"agent": name, "submission": order.model_dump()})
    return _store(services, caller, name, AgentKind(order.kind), info, None, (idempotency_key, request))


@router.post("/onnx", status_code=201, responses=problems(403, 404, 409, 413, 507), openapi_extra=FORM)
async def create_onnx_submission(
    name: Name, request: Request, caller: Submitter, services: ServicesOf, idempotency_key: IdempotencyKey = None
) -> SubmissionView:
    """Submits an ONNX policy: checked, tried for two decisions, and later run without network, files or privileges."""
    async with receive_upload(request, services.settings.upload_limit_bytes) as given:
        return await run_in_threadpool(_submit_onnx, services, caller, name, given, idempotency_key)


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


def _builtin(order: BuiltinOrder) -> AgentInfo:
    """Describes the agent, in a confined process, since its settings come from a stranger."""
    try:
        check_builtin(order.entry, order.settings)
    except UnknownNameError as error:
        raise InvalidInputError(str(error)) from error
    entry = agent_entries()[order.entry]
    arguments, imports = {"entry": entry, "settings": order.settings}, [entry.partition(":")[0]]
    return AgentInfo.model_validate(run("describe_agent", arguments, TRIAL, imports=imports))


def _remote(order: RemoteOrder, agent: str) -> AgentInfo:
    try:
        make_sensors(order.sensors, Track[order.track.upper()])
        if order.control not in CONTROLS:
            raise UnknownNameError("control", order.control, CONTROLS)
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


def _submit_onnx(services: Services, caller: Caller, name: str, given: Upload, key: str | None) -> SubmissionView:
    _check_owner(services, caller, name)
    spec = _spec(given.fields.get("spec"), name)
    content = given.path.read_bytes()
    limits = PolicyLimits(file_mb=services.settings.upload_limit_bytes / MEGABYTE)
    try:
        policy = OnnxPolicy(content=content, **spec.model_dump(), limits=limits)
    except UnknownNameError as error:
        raise InvalidInputError(str(error)) from error
    info = agent_info(policy, ENTRY, policy.settings, "onnx")
    request = content_hash({"agent": name, "spec": spec.model_dump(mode="json"), "sha256": policy.sha256})
    _keep(services.settings.policies, content)
    return _store(services, caller, name, AgentKind.ONNX, info, policy.sha256, (key, request))


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
        agent = owned_agent(session, caller, name)
        if queries.count_submissions(session, agent) >= PER_AGENT:
            raise TooManyRequestsError(f"at most {PER_AGENT} submissions of one agent", retry_s=3600)


def _store(
    services: Services,
    caller: Caller,
    name: str,
    kind: AgentKind,
    info: AgentInfo,
    policy_sha256: str | None,
    once: tuple[str | None, str],
) -> SubmissionView:
    key, request = once
    with services.database.session() as session:
        if before := made_before(session, caller.owner, key, request):
            return view_submission(_made(session, before), name)
        agent = owned_agent(session, caller, name)
        submission = queries.add_submission(session, agent, kind, info, policy_sha256)
        remember(session, caller.owner, key, request, submission.id)
        return view_submission(submission, name)


def _made(session: Session, identifier: str) -> Submission:
    return session.get_one(Submission, identifier)


def _keep(folder: Path, content: bytes) -> None:
    """Stores a policy under its hash, complete or not at all."""
    path = folder / f"{hashlib.sha256(content).hexdigest()}.onnx"
    if not path.exists():
        write_atomically(path, content)
