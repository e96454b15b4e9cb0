"""Redrives: recorded episodes driven again, few at a time, each in a confined process."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from typing import Any, Final

from dohyo.agents.registry import agent_entries
from dohyo.evaluation.records.store import read_record
from dohyo.service.boards.standings import Recent
from dohyo.service.confinement.folders import private_folder
from dohyo.service.confinement.limits import Limits
from dohyo.service.confinement.runner import run_async
from dohyo.service.episodes.redrive import TRACE
from dohyo.service.errors import BusyError, ConflictError
from dohyo.service.policies.agent import ENTRY as POLICY
from dohyo.service.policies.agent import FOLDER_VARIABLE, SHA256
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.networks.entries import user_catalog

AT_ONCE: Final = 2
WAITING: Final = 16
LIMITS: Final = Limits(wall_s=900.0, cpu_s=900, memory_mb=6000, file_mb=200, folder_mb=500, processes=4)
FAILURES: Final = 200
TRACE_FORMAT: Final = 1

logger = logging.getLogger("dohyo.service")


class Redrives:
    """Running redrives, on the event loop only. Requests for the same record share one drive."""

    def __init__(self, policies: Path) -> None:
        self._policies = policies.resolve()
        self._environment = {FOLDER_VARIABLE: str(self._policies), "DOHYO_HOME": str(user_catalog().resolve().parent)}
        self._room = asyncio.Semaphore(AT_ONCE)
        self._tasks: dict[Path, asyncio.Task[dict[str, Any]]] = {}
        self._failures: Recent[Path, str] = Recent(FAILURES)

    async def verify(self, record: Path) -> dict[str, Any]:
        """Drives a record's episode again, and waits for the answer of `redrive.drive_again`.

        Raises:
            ConflictError: The versions or the agent changed, or the redrive did not end.
            BusyError: Too many redrives wait already.
        """
        return await asyncio.shield(self._begun(record))

    async def explain(self, record: Path) -> Path | None:
        """File of a record's explanations; None while they are being collected.

        Raises:
            ConflictError: They cannot be collected; the answer is cached.
            BusyError: Too many redrives wait already.
        """
        trace = trace_path(record)
        if trace.exists():
            return trace
        failure = self._failures.get(record)
        if failure is not None:
            raise ConflictError(failure)
        self._begun(record)
        return None

    def _begun(self, record: Path) -> asyncio.Task[dict[str, Any]]:
        task = self._tasks.get(record)
        if task is None:
            if len(self._tasks) >= WAITING:
                raise BusyError(f"{WAITING} episodes are waiting to be driven again", retry_s=30)
            task = self._tasks[record] = asyncio.create_task(self._drive(record))
            task.add_done_callback(lambda _: self._ended(record))
        return task

    def _ended(self, record: Path) -> None:
        task = self._tasks.pop(record)
        if task.cancelled():
            return
        error = task.exception()
        if error is not None:
            logger.warning("%s cannot be driven again: %s", record.name, error)
            self._failures.put(record, str(error))
        elif not task.result()["same"]:
            logger.error("%s: driven again, its episode gave a different record", record.name)
            self._failures.put(record, "driven again, the episode gave a different record: expected the same hash")

    async def _drive(self, record: Path) -> dict[str, Any]:
        async with self._room:
            with private_folder() as folder:
                reads, imports = await asyncio.to_thread(self._needs, record)
                try:
                    answer: dict[str, Any] = await run_async(
                        *("redrive", {"record": str(record)}, LIMITS),
                        folder=folder,
                        reads=reads,
                        imports=imports,
                        environment=self._environment,
                    )
                except InvalidInputError as error:
                    raise ConflictError(str(error)) from error
                if answer["same"]:
                    await asyncio.to_thread(_keep, folder / TRACE, trace_path(record))
        return answer

    def _needs(self, record: Path) -> tuple[list[Path], list[str]]:
        """Files and modules that the drive reads: of a policy its own file alone, since others belong to others."""
        reads, imports = [record, user_catalog()], []
        entries = set(agent_entries().values())
        for ego in read_record(record).egos:
            if ego.agent.entry == POLICY and SHA256.fullmatch(name := str(ego.agent.settings.get("sha256"))):
                reads.append(self._policies / f"{name}.onnx")
            elif ego.agent.entry in entries:
                imports.append(ego.agent.entry.partition(":")[0])
        return reads, imports


def _keep(trace: Path, path: Path) -> None:
    """Stores explanations that a confined process has written."""
    if trace.is_symlink() or not trace.is_file():
        raise ConflictError("driven again, the episode gave no explanations")
    write_atomically(path, trace.read_bytes())


def trace_path(record: Path) -> Path:
    """Path of a record's explanations, beside the record."""
    return record.with_name(f"{record.stem}.explanations-{TRACE_FORMAT}.jsonl.gz")
