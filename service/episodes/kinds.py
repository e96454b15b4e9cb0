"""Jobs of this room: a recorded episode is driven again, to compare its record and to keep its explanations."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any, Final

from dohyo.agents.registry import agent_entries
from dohyo.evaluation.parking.lot_files import is_lot, read_lot
from dohyo.evaluation.records.store import read_record
from dohyo.service.confinement.folders import private_folder
from dohyo.service.confinement.limits import Limits
from dohyo.service.confinement.runner import run
from dohyo.service.episodes.archive import archived_path
from dohyo.service.episodes.explanations import TRACE
from dohyo.service.episodes.recorded_agents import POLICY_SETTINGS
from dohyo.service.errors import ConflictError
from dohyo.service.jobs.kind import Kind, Made, Task
from dohyo.service.policies.agent import FOLDER_VARIABLE, SHA256
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.networks.entries import user_catalog

LIMITS: Final = Limits(wall_s=900.0, cpu_s=900, memory_mb=6000, file_mb=200, folder_mb=500, processes=4)
TRACE_FORMAT: Final = 1

logger = logging.getLogger("dohyo.service")


def redrive(task: Task) -> Made:
    """Drives an episode's record again; keeps the explanations if the new record is the same.

    Raises:
        ConflictError: The versions or the agent changed, or the redrive did not end.
    """
    settings, episode = task.services.settings, task.arguments["episode"]
    record, policies = archived_path(settings, task.arguments["record"]), settings.policies.resolve()
    environment = {FOLDER_VARIABLE: str(policies), "DOHYO_HOME": str(user_catalog().resolve().parent)}
    try:
        reads, imports = _needs(record, policies)
        with private_folder() as folder:
            answer: dict[str, Any] = run(
                *("redrive", {"record": str(record)}, LIMITS),
                folder=folder,
                reads=reads,
                imports=imports,
                environment=environment,
                stopped=task.stop.is_set,
            )
            if answer["same"] and not is_lot(record):
                _keep(folder / TRACE, trace_path(record))
            elif not answer["same"]:
                logger.error("%s: driven again, its episode gave a different record", record.name)
    except InvalidInputError as error:
        raise ConflictError(str(error)) from error
    return Made({"episode": episode, **answer})


REDRIVE: Final = Kind("redrive", redrive, limit_s=LIMITS.wall_s + 60.0)


def trace_path(record: Path) -> Path:
    """Path of a record's explanations, beside the record."""
    return record.with_name(f"{record.stem}.explanations-{TRACE_FORMAT}.jsonl.gz")


def _needs(record: Path, policies: Path) -> tuple[list[Path], list[str]]:
    """Files and modules that the drive reads: of a policy its own file alone, since others belong to others."""
    reads, imports = [record, user_catalog()], []
    entries = set(agent_entries().values())
    for agent in [read_lot(record).agent] if is_lot(record) else [ego.agent for ego in read_record(record).egos]:
        if agent.entry in POLICY_SETTINGS and SHA256.fullmatch(name := str(agent.settings.get("sha256"))):
            reads.append(policies / f"{name}.onnx")
        elif agent.entry in entries:
            imports.append(agent.entry.partition(":")[0])
    return reads, imports


def _keep(trace: Path, path: Path) -> None:
    """Stores explanations that a confined process has written."""
    if trace.is_symlink() or not trace.is_file():
        raise ConflictError("driven again, the episode gave no explanations")
    write_atomically(path, trace.read_bytes())
