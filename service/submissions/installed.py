"""Whether built-in agents are still the ones that were submitted: an upgrade of dohyo may have changed their code."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from dohyo.agents.registry import agent_entries
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.confinement.limits import Limits
from dohyo.service.confinement.runner import run
from dohyo.service.errors import ConflictError
from dohyo.service.running.order import check_unchanged
from dohyo.service.submissions.model import AgentKind, Submission
from dohyo.sumo_networks.errors import InvalidInputError

TRIAL: Final = Limits(wall_s=60.0, cpu_s=60, memory_mb=3000, file_mb=1, folder_mb=10)

_unchanged: set[str] = set()
"""Submissions that this process has described: a second order of them costs nothing."""


def describe(entry: str, settings: Mapping[str, Any], stopped: Callable[[], bool] = lambda: False) -> AgentInfo:
    """Describes a built-in agent, in a confined process, since its settings come from a stranger.

    Args:
        entry: Its "module:Class".
        settings: Plain JSON.
        stopped: Asked now and then; once true, the process is ended.

    Raises:
        InvalidInputError: It cannot be made with these settings.
        BusyError: Too many agents are being described.
        ConfinementError: This machine cannot confine a process.
    """
    arguments, imports = {"entry": entry, "settings": settings}, [entry.partition(":")[0]]
    return AgentInfo.model_validate(run("describe_agent", arguments, TRIAL, imports=imports, stopped=stopped))


def note_unchanged(submission: str) -> None:
    """Notes that a submission was described by the installed code."""
    _unchanged.add(submission)


def check_installed(submissions: Iterable[Submission]) -> None:
    """Refuses built-in agents whose installed code is not the one that was submitted: their records would be wrong.

    It may take seconds for each that was submitted before this process began, so call it outside of transactions.

    Raises:
        ConflictError: The code or a file of an agent differs, or it cannot be made any more.
        BusyError: Too many agents are being described.
        ConfinementError: This machine cannot confine a process.
    """
    for submission in submissions:
        if submission.kind is not AgentKind.BUILTIN or submission.id in _unchanged:
            continue
        info = AgentInfo.model_validate(submission.info)
        if info.source_sha256:
            _check(info)
        note_unchanged(submission.id)


def _check(info: AgentInfo) -> None:
    if info.entry not in agent_entries().values():
        raise ConflictError(f"agent '{info.name}' cannot be made any more: no built-in agent is '{info.entry}'")
    try:
        there = describe(info.entry, info.settings)
    except InvalidInputError as error:
        raise ConflictError(f"agent '{info.name}' cannot be made any more: {error}; submit it again") from error
    try:
        check_unchanged(info, there)
    except InvalidInputError as error:
        raise ConflictError(str(error)) from error
