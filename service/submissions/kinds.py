"""Jobs of this room: a submission that must be tried before it is stored."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Final

from dohyo.agents.registry import agent_entries
from dohyo.evaluation.agent import AgentSpec, agent_info
from dohyo.evaluation.families import Family, family_for
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.forecasting.interface import POLICY as FORECASTER
from dohyo.service.forecasting.interface import check_forecaster
from dohyo.service.forecasting.policy import OnnxForecaster
from dohyo.service.jobs.kind import Kind, Made, Task
from dohyo.service.parking.interface import POLICY as PARKER
from dohyo.service.parking.interface import check_parker, state_of
from dohyo.service.policies.agent import ENTRY, OnnxPolicy
from dohyo.service.policies.limits import MEGABYTE, PolicyLimits
from dohyo.service.storage.files import file_lock
from dohyo.service.submissions import queries
from dohyo.service.submissions.installed import describe, note_unchanged
from dohyo.service.submissions.model import AgentKind, Submission
from dohyo.service.submissions.views import view_submission
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.files import write_atomically

if TYPE_CHECKING:
    from dohyo.service.parking.policy import OnnxParker


def try_builtin(task: Task) -> Made:
    """Describes a built-in agent, in a confined process, since its settings come from a stranger."""
    entry = agent_entries()[task.arguments["entry"]]
    return _store(task, AgentKind.BUILTIN, describe(entry, task.arguments["settings"], task.stop.is_set))


def try_onnx(task: Task) -> Made:
    """Checks an ONNX file and tries it for two decisions, in confined processes, then keeps it by its hash."""
    content = task.file.read_bytes()
    limits = PolicyLimits(file_mb=task.services.settings.upload_limit_bytes / MEGABYTE)
    try:
        policy = _policy(content, AgentSpec(**task.arguments["spec"]), limits)
    except UnknownNameError as error:
        raise InvalidInputError(str(error)) from error
    info = agent_info(policy, _entry(policy), policy.settings, "onnx")  # type: ignore[arg-type]  # it reads the spec alone
    if task.stop.is_set():
        raise InvalidInputError("it was cancelled")
    with file_lock(policy.sha256):
        _keep(task.services.settings.policies, content)
        return _store(task, AgentKind.ONNX, info, policy.sha256, len(content))


BUILTIN: Final = Kind("builtin_submission", try_builtin, limit_s=120.0)
ONNX: Final = Kind("onnx_submission", try_onnx, limit_s=300.0)


def _store(task: Task, kind: AgentKind, info: AgentInfo, policy_sha256: str | None = None, kept_bytes: int = 0) -> Made:
    """Stores the submission under the job's identifier, so that a job that is repeated stores it once."""
    name, identifier = task.arguments["agent"], task.id.replace("job-", "sub-")
    with task.services.database.session() as session:
        submission = session.get(Submission, identifier)
        if submission is None:
            agent = queries.find_agent(session, name)
            if agent is None:
                raise InvalidInputError(f"agent '{name}' was deleted meanwhile")
            submission = queries.add_submission(
                *(session, agent, kind, info, policy_sha256), identifier=identifier, kept_bytes=kept_bytes
            )
            if kind is AgentKind.BUILTIN:
                note_unchanged(identifier)
        view = view_submission(submission, name)
    return Made(view.model_dump(mode="json"), f"/v1/agents/{name}/submissions/{view.version}")


def _entry(policy: OnnxPolicy | OnnxParker | OnnxForecaster) -> str:
    """Entry of an uploaded policy in records."""
    return ENTRY if isinstance(policy, OnnxPolicy) else FORECASTER if isinstance(policy, OnnxForecaster) else PARKER


def _policy(content: bytes, spec: AgentSpec, limits: PolicyLimits) -> OnnxPolicy | OnnxParker | OnnxForecaster:
    family = family_for(spec.control)
    if family is Family.FORECASTING:
        check_forecaster(spec.track, spec.sensors)
        return OnnxForecaster(content=content, name=spec.name, limits=limits)
    if family is not Family.PARKING:
        return OnnxPolicy(content=content, **spec.model_dump(), limits=limits)
    check_parker(spec.track, spec.sensors)
    from dohyo.service.parking.policy import OnnxParker  # loads numba

    return OnnxParker(content=content, name=spec.name, state=state_of(spec.sensors[0]), limits=limits)


def _keep(folder: Path, content: bytes) -> None:
    """Stores a policy under its hash, complete or not at all."""
    path = folder / f"{hashlib.sha256(content).hexdigest()}.onnx"
    if not path.exists():
        write_atomically(path, content)
