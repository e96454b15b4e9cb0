"""Redrives: recorded episodes driven again, few at a time, each in a separate process."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import sys
from pathlib import Path
from typing import Any, Final

from dohyo.service.boards.standings import Recent
from dohyo.service.errors import BusyError, ConflictError

AT_ONCE: Final = 2
WAITING: Final = 16
TIME_LIMIT_S: Final = 900.0
FAILURES: Final = 200
TRACE_FORMAT: Final = 1

logger = logging.getLogger("dohyo.service")


class Redrives:
    """Running redrives, on the event loop only. Requests for the same record share one drive."""

    def __init__(self, policies: Path) -> None:
        self._environment = os.environ | {"DOHYO_POLICIES": str(policies.resolve()), "OMP_NUM_THREADS": "1"}
        self._room = asyncio.Semaphore(AT_ONCE)
        self._tasks: dict[Path, asyncio.Task[dict[str, Any]]] = {}
        self._failures: Recent[Path, str] = Recent(FAILURES)

    async def verify(self, record: Path) -> dict[str, Any]:
        """Drives a record's episode again, and waits for the answer of `dohyo.service.episodes.redrive`.

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
            command = (sys.executable, "-m", "dohyo.service.episodes.redrive", str(record), str(trace_path(record)))
            pipe = asyncio.subprocess.PIPE
            child = await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, env=self._environment)
            assert child.stdout is not None
            try:
                text = await asyncio.wait_for(child.stdout.read(), TIME_LIMIT_S)
            except TimeoutError:
                raise ConflictError(f"the replay did not end within {TIME_LIMIT_S:g} s") from None
            finally:
                if child.returncode is None and not child.stdout.at_eof():
                    child.kill()
                await child.wait()
        try:
            answer: dict[str, Any] = json.loads(text)
        except ValueError:
            raise ConflictError(f"the replay's process ended with code {child.returncode}") from None
        if "error" in answer:
            raise ConflictError(str(answer["error"]))
        return answer


def trace_path(record: Path) -> Path:
    """Path of a record's explanations, beside the record."""
    return record.with_name(f"{record.stem}.explanations-{TRACE_FORMAT}.jsonl.gz")
